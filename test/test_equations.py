"""docs/equations.md names functions and tests that exist."""

from __future__ import annotations

import re

import pytest
from code_names import ROOT, SRC, c_exists, exists, names

TEXT = (ROOT / 'docs' / 'equations.md').read_text()
FUNCTIONS = sorted(set(re.findall(r'`(waam_\w+(?:\.\w+){2,})`', TEXT)))
TESTS = sorted(set(re.findall(r'`(waam_\w+/test/\w+\.py)::(\w+)`', TEXT)))
C_FUNCTIONS = sorted(set(re.findall(r'`(waam_\w+/core/[\w/]+\.c): (\w+)`', TEXT)))


def test_the_page_has_what_it_promises():
    assert len(FUNCTIONS) > 20 and len(TESTS) > 20 and C_FUNCTIONS


@pytest.mark.parametrize('path', FUNCTIONS)
def test_function_exists(path):
    assert exists(path)


@pytest.mark.parametrize(('file', 'name'), TESTS)
def test_test_exists(file, name):
    assert name in names((SRC / file).read_text())


@pytest.mark.parametrize(('file', 'name'), C_FUNCTIONS)
def test_c_function_exists(file, name):
    assert c_exists(file, name)
