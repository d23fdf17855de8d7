"""The thickness of layers: what the tolerance decides, and that every depth is filled."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_plan.layers.restore import plan_restoration
from waam_plan.layers.schedule import (
    LAYER_SHARE,
    SCATTER,
    SIGMAS,
    choose_schedule,
    finish_height,
    ideal_count,
)
from waam_plan.settings import PlanSettings

FINE = PlanSettings(tolerance=0.2e-3)
DEPTHS = st.lists(st.floats(0.0, 0.03), min_size=1, max_size=40).map(np.array)
SETTINGS = st.builds(
    PlanSettings,
    tolerance=st.sampled_from([0.0, 0.1e-3, 0.2e-3, 0.3e-3, 1e-3]),
    finish_layers=st.integers(0, 5),
    layer_height=st.floats(1e-3, 3e-3),
)


def test_finishing_layers_scatter_by_the_share_of_the_tolerance_that_they_may_take():
    top = finish_height(FINE)
    assert SIGMAS * SCATTER * top == pytest.approx(LAYER_SHARE * FINE.tolerance)
    assert 1.0e-3 < top < 1.3e-3


def test_without_tolerance_or_with_a_wide_one_all_layers_are_alike():
    for s in (
        PlanSettings(),
        PlanSettings(tolerance=1e-3),
        PlanSettings(tolerance=0.2e-3, finish_layers=0),
    ):
        schedule = choose_schedule(np.full(9, 0.012), s)
        assert schedule.finishing == 0 and schedule.below == pytest.approx(2e-3, rel=0.15)


def test_finishing_layers_are_as_many_and_as_thick_as_asked():
    s = PlanSettings(tolerance=0.2e-3, finish_layers=4, finish_height=1e-3)
    schedule = choose_schedule(np.full(9, 0.012), s)
    assert schedule.tops == pytest.approx([1e-3] * 4)
    assert schedule.offset(5) == pytest.approx(4e-3)
    assert '4 finishing layers of 1.00 mm' in schedule.reason(s)


def test_a_height_that_is_set_wins_and_a_hopeless_tolerance_is_bounded():
    assert finish_height(PlanSettings(tolerance=0.2e-3, finish_height=1.5e-3)) == 1.5e-3
    assert finish_height(PlanSettings(tolerance=0.01e-3)) == pytest.approx(0.4 * 2e-3)


@given(DEPTHS, SETTINGS)
def test_every_place_gets_layers_whose_lowest_one_takes_what_is_left(depth, s):
    schedule = choose_schedule(depth, s)
    count = ideal_count(depth, schedule, s)
    for d, k in zip(depth, count, strict=True):
        if k == 0:
            assert d < s.min_layer * s.layer_height
            continue
        lowest = d - schedule.offset(int(k))
        assert (
            -1e-9
            < lowest
            <= max(
                schedule.thickest, max(schedule.tops, default=0.0) + s.min_layer * schedule.below
            )
            + 1e-9
        )
    assert (np.diff(count[np.argsort(depth)]) >= 0).all()


@given(SETTINGS)
def test_offsets_are_the_sums_of_the_thicknesses(s):
    schedule = choose_schedule(np.linspace(0, 0.02, 50), s)
    sums = np.cumsum([schedule.thickness(k) for k in range(1, 12)])
    assert [schedule.offset(k + 1) for k in range(1, 12)] == pytest.approx(list(sums))


def test_a_plan_is_thin_on_top_ends_at_nominal_and_says_why(worn_block):
    found, nominal = worn_block(0.011)
    plan = plan_restoration(found, nominal, FINE)
    thick = [float(np.median(p.planned[p.planned > 0])) for p in plan.layers]
    assert thick[-3:] == pytest.approx([finish_height(FINE)] * 3, rel=1e-6)
    assert min(thick[:-3]) > 1.5 * thick[-1]
    middle = plan.interior & (nominal.z > 0)
    assert np.nanmax(np.abs(plan.final_target - nominal.z)[middle]) < 1e-9
    assert '3 finishing layers of 1.00 mm' in plan.remarks[0] and '0.20 mm' in plan.remarks[0]
