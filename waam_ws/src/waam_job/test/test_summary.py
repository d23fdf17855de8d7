"""Figures of a run that depend on its material."""

from __future__ import annotations

import math

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


def test_deposition_rate_is_the_metal_of_both_layers_over_the_time_of_the_arc():
    """6 m and 12 m of wire of 1.2 mm in a minute and two and a half, 92 % of it on the part."""
    layers = (
        LayerRecord(wire_used=6.0, arc_on_time=60.0),
        LayerRecord(wire_used=12.0, arc_on_time=150.0),
    )
    kilograms = 18.0 * math.pi / 4 * 1.2e-3**2 * 7850 * 0.92
    assert summary('er70s-6', *layers)['deposition_kg_h'] == pytest.approx(kilograms / (210 / 3600))


def test_a_run_without_arc_has_no_deposition_rate():
    assert summary('er70s-6', LayerRecord())['deposition_kg_h'] is None
    assert summary('er70s-6')['deposition_kg_h'] is None
