"""Control charts against values worked out by hand, key figures, cost, traceability."""

from __future__ import annotations

import math
from datetime import datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_archive.charts import ChartError, chart, cpk, signals
from waam_archive.figures import cost, grouped, key_figures
from waam_archive.page import part_page
from waam_archive.schema import names
from waam_archive.traceability import part_record
from waam_process.prices import PriceError, Prices

# ---- control charts ------------------------------------------------------------------------------


def test_x_bar_and_r_by_hand():
    values = [
        5.0,
        5.2,
        4.8,
        5.1,
        5.0,
        5.3,
        4.9,
        5.0,
        5.2,
    ]  # means 5.0, 5.1333, 5.0333; ranges 0.4, 0.3, 0.3
    found = chart(np.array(values), 3)
    assert found.center == pytest.approx(5.05556, abs=1e-5) and found.range_center == pytest.approx(
        1 / 3
    )
    assert found.upper == pytest.approx(5.05556 + 1.023 / 3, abs=1e-5)
    assert found.range_upper == pytest.approx(2.574 / 3) and found.range_lower == 0
    assert found.sigma == pytest.approx(1 / 3 / 1.693)


def test_single_values_have_moving_ranges():
    found = chart(np.array([10.0, 12.0, 11.0, 13.0]), spec=(4.0, 20.0))
    assert found.range_center == pytest.approx(5 / 3) and math.isnan(found.ranges[0])
    assert found.upper == pytest.approx(11.5 + 2.66 * 5 / 3, abs=1e-2)
    assert found.cpk == pytest.approx(7.5 / (3 * 5 / 3 / 1.128))


def test_capability():
    assert (
        cpk(10, 1, (4, 19)) == 2 and cpk(10, 1, (-math.inf, 13)) == 1 and cpk(10, 1, (11, 20)) < 0
    )
    assert math.isnan(cpk(10, 1, (-math.inf, math.inf))) and cpk(10, 0, (4, 19)) == math.inf


def test_scatter_that_grows_is_named_though_the_means_are_steady():
    groups = [[4.9, 5.0, 5.1]] * 12 + [[4.0, 5.0, 6.0]]
    found = chart(np.ravel(groups), 3, baseline=12)
    (signal,) = found.signals
    assert signal.of_ranges and signal.points == (12,) and 'scatter has grown' in signal.text


def test_limits_come_from_the_baseline_and_what_is_left_over_is_said():
    values = np.r_[np.tile([1.0, 2.0], 10), 9.0]
    assert chart(values, 2, baseline=5).left_over == 1
    assert chart(values, 1, baseline=20).center == 1.5
    with pytest.raises(ChartError, match='needs two'):
        chart(np.array([1.0, 2.0, 3.0]), 2)
    with pytest.raises(ChartError, match='1 to 10'):
        chart(values, 11)


PATTERNS = {  # z values that break exactly this rule, and where
    'nelson 1': ([0.5, -0.5, 3.2, 0.4, -0.3], 2),
    'nelson 2': ([-0.5, *[0.5, 0.7, 0.2, 0.6, 0.4, 0.3, 0.5, 0.2, 0.4]], 9),
    'nelson 3': ([-0.5, -0.3, -0.1, 0.1, 0.3, 0.5], 5),
    'nelson 4': ([0.6, -0.6, 1.2, -1.2] * 3 + [0.6, -0.6], 13),
    'nelson 5': ([0.1, 2.2, -0.2, 2.3], 3),
    'nelson 6': ([-0.2, 1.2, 1.3, 0.5, 1.4, 1.1], 5),
    'nelson 7': ([1.5, *[0.5, -0.4, -0.2, 0.3, 0.6, -0.5, -0.1, 0.4, -0.6, -0.3, 0.2, 0.1, -0.2, 0.5, 0.3]], 15),
    'nelson 8': ([1.5, -1.2, -1.3, 1.4, 1.2, -1.1, 1.3, -1.4], 7),
}  # fmt: skip


@pytest.mark.parametrize('rule', PATTERNS)
def test_a_rule_names_its_pattern_and_no_other_does(rule):
    z, at = PATTERNS[rule]
    found = {s.rule: s.points for s in signals(np.array(z), 0.0, 1.0)}
    assert found == {rule: (at,)}
    mirrored = {s.rule: s.points for s in signals(-np.array(z), 0.0, 1.0)}
    assert mirrored == found


def test_a_stable_process_seldom_alarms_and_a_drift_always():
    rng = np.random.default_rng(5)
    alarms = [len(chart(rng.normal(size=100), baseline=50).signals) for _ in range(30)]
    assert np.mean([a == 0 for a in alarms]) > 0.1
    for _ in range(30):
        drifting = rng.normal(size=100) + np.r_[np.zeros(50), np.linspace(0, 5, 50)]
        assert chart(drifting, baseline=50).signals


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=60), st.integers(1, 10))
def test_any_values_make_a_chart_or_an_error(values, group):
    try:
        found = chart(np.array(values), group)
    except ChartError:
        assert len(values) // group < 2
        return
    assert found.lower <= found.center <= found.upper
    assert len(found.means) * group + found.left_over == len(values)
    assert all(0 <= i < len(found.means) for s in found.signals for i in s.points)


# ---- key figures ---------------------------------------------------------------------------------

JOB = {
    **dict.fromkeys(names('jobs')), 'job': 'a', 'part': 'jaw.stl', 'material': 'er70s-6', 'verdict': 'in tolerance',
    'metal_kg': 1.8, 'wire_kg': 2.0, 'duration_s': 7200.0, 'arc_on_s': 3600.0, 'energy_J': 3.6e6, 'area_mm2': 2e4,
    'judged_cells': 100, 'defect_cells': 4, 'efficiency': 0.9, 'material_use': 0.8, 'created': datetime(2026, 2, 1),
    'has_report': True,
}  # fmt: skip
PRICES = Prices.parse(
    {'wire_per_kg': {'er70s-6': 5, 'default': 9}, 'gas_per_hour': 3, 'energy_per_kWh': 0.5, 'machine_per_hour': 40,
     'labour_per_hour': 30, 'labour_share': 0.5}
)  # fmt: skip


def test_figures_of_one_job_by_hand():
    f = key_figures([JOB], PRICES)
    assert (f['kg_per_arc_hour'], f['kg_per_hour']) == (pytest.approx(1.8), pytest.approx(0.9))
    assert f['wire_kg_per_m2'] == pytest.approx(100) and f['energy_kWh_per_m2'] == pytest.approx(50)
    assert f['defect_share_of_area'] == pytest.approx(0.04) and f['defect_share_of_jobs'] == 0
    assert cost(JOB, PRICES)['total'] == f['cost'] == pytest.approx(10 + 3 + 0.5 + 80 + 30)
    assert f['cost_per_m2'] == pytest.approx(123.5 / 0.02) and f['cost_wire'] == 10


def test_jobs_without_an_amount_do_not_spoil_a_ratio():
    bare = {**JOB, 'area_mm2': None, 'efficiency': None, 'verdict': 'failed', 'arc_on_s': None}
    f = key_figures([JOB, bare], PRICES)
    assert f['wire_kg_per_m2'] == pytest.approx(100) and f['efficiency'] == pytest.approx(0.9)
    assert f['kg_per_hour'] == pytest.approx(0.9) and f['defect_share_of_jobs'] == 0.5
    assert f['jobs_without_cost'] == 1 and f['cost_per_job'] == pytest.approx(123.5)
    assert all(
        v is None for k, v in key_figures([]).items() if k not in ('jobs', 'in_tolerance', 'failed')
    )


def test_groups():
    other = {**JOB, 'material': None, 'created': None}
    assert list(grouped([JOB, other], 'material')) == ['-', 'er70s-6']
    assert list(grouped([JOB, other], 'month')) == ['-', '2026-02']


@pytest.mark.parametrize(
    'data,said',
    [
        ([], 'mapping'), ({'wire': 3}, "'wire'"), ({'gas_per_hour': -1}, 'gas_per_hour'), ({'gas_per_hour': 'x'},
        'gas'),
        ({'wire_per_kg': {'a': math.nan}}, 'wire_per_kg.a'), ({'machine_per_hour': True}, 'machine_per_hour'),
    ],
)  # fmt: skip
def test_a_wrong_price_is_named(data, said):
    with pytest.raises(PriceError, match=said):
        Prices.parse(data)


# ---- traceability --------------------------------------------------------------------------------


def test_a_record_names_what_nobody_told_and_a_page_is_safe():
    told = {
        'operator': '<script>alert(1)</script>',
        'wire_lot': '4711',
        'gas': 'M21',
        'part_sha256': 'ab',
        'cell': 'c',
    }
    first = {**JOB, **told, 'software': 's', 'controller': 'k', 'sha256': 'x', 'source': '/jobs/a'}
    second = {
        **first,
        'job': 'b',
        'operator': None,
        'part_sha256': 'cd',
        'created': datetime(2026, 1, 1),
    }
    reports = [
        {'job': 'a', 'report': '{"trace": {"programs": {"p.gcode": {"sha256": "12"}}}}'},
        {'job': 'b', 'report': 'x'},
    ]
    anomaly = {'severity': 'FAULT', 'class_name': 'arc', 'text': '<b>', 'reaction': 'abort'}
    record = part_record('jaw.stl', [first, second], reports, [{'job': 'a', **anomaly}], [])
    assert [e['job'] for e in record['jobs']] == ['b', 'a']
    assert record['jobs'][0]['not_told'] == ['operator', 'calibration of the scanner']
    assert record['jobs'][1]['programs'] == {'p.gcode': '12'}
    assert '2 different hashes' in record['remarks'][0] and '2 of 2' in record['remarks'][1]
    page = part_page(record)
    assert '<script>' not in page and '&lt;script&gt;' in page and 'Not told: operator' in page
