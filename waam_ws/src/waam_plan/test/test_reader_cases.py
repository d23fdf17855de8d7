"""Every case of the readers: read as it is, or refused by the true cause."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from reader_case import fault
from reader_cases import CASES


@pytest.mark.parametrize('case', CASES, ids=lambda case: f'{case.name} {case.about}')
def test_a_file_is_read_wholly_or_refused_by_its_true_cause(case, tmp_path):
    assert fault(case, tmp_path) == ''


def test_there_are_enough_cases_and_none_twice():
    assert len(CASES) >= 60 and len({(c.name, c.about) for c in CASES}) == len(CASES)
