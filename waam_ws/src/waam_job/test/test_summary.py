"""Figures of a run that depend on its material."""

from __future__ import annotations

import pytest

from waam_job.model.records import LayerRecord, Status
from waam_job.model.summary import run_summary
from waam_job.model.verdict import Verdict
from waam_process.materials import get


def summary(material, *layers):
    return run_summary(
        Verdict(0.95, 0.2e-3), Status('one', '.'), layers=list(layers), anomalies=[], passes=[],
        material=get(material),
    )  # fmt: skip


@pytest.mark.parametrize(
    'material, terms',
    [('er70s-6', ['height', 'current']), ('316l', ['height']), ('er4043', ['height'])],
)
def test_the_report_says_whether_the_cost_counts_the_current(material, terms):
    assert summary(material, LayerRecord(cost=0.5))['cost_terms'] == terms
