"""Bead width held by the voltage, from layer to layer."""

import dataclasses
import math

import numpy as np
import pytest

from waam_adapt.feed.feed_forward import Field, Limits, Path, SetpointError, compute
from waam_adapt.identify.bead_width import UNKNOWN, SeenWidth, WidthEstimate, WidthIdentifier
from waam_process import materials
from waam_process.grid import GridSpec
from waam_process.segment import Clamp, Kind

STEEL = materials.get('er70s-6')
LIMITS = Limits.of(STEEL, (3e-3, 20e-3), (0.033, 0.2))
SPEC = GridSpec(0.0, 0.0, 1e-3, 40, 60)


def path(n=6, height=2e-3, width=6e-3):
    """n beads of 40 mm with moves between them."""
    y = 5e-3 * np.arange(n)
    start = np.column_stack([np.full(n, 0.01), y, np.zeros(n)])
    kind = np.where(np.arange(n) % 3 == 2, int(Kind.IDLE), int(Kind.DEPOSIT))
    ones = np.ones(n)
    return Path(
        np.arange(n), kind, start, start + [0.04, 0, 0], height * ones, width * ones, 0.01 * ones
    )


def setpoints(p, ratio, apply=True):
    zero = np.zeros(SPEC.shape)
    field = Field(SPEC, zero, zero, 0.3, 1.0, ratio)
    return compute(p, STEEL, LIMITS, 22.0, field, apply)


def width_of(feed, speed, voltage, factor, exponent=0.35):
    """A process that is wider than the table by `factor` and answers to the voltage less than eq 2.13 says."""
    return factor * STEEL.width(feed, speed, 22.0) * (voltage / 22.0) ** exponent


@pytest.mark.parametrize('factor', [0.94, 1.08])
def test_a_wrong_width_is_taken_away_within_three_layers(factor):
    identifier, ratio, p = WidthIdentifier(), 0.0, path()
    for layer in range(1, 5):
        s = setpoints(p, ratio)
        at = (s.wire_feed_speed[0], s.speed[0], s.voltage[0])
        width = width_of(*at, factor)
        seen = SeenWidth(width, 0.05e-3, STEEL.width(*at))
        ratio = identifier.add('job', layer + 1, seen).ratio
    assert width == pytest.approx(6e-3, rel=0.01)


def test_thin_layers_get_the_voltage_that_their_wire_takes_from_the_width():
    thick, thin = setpoints(path(), 1.0), setpoints(path(height=1.7e-3), 1.0)
    assert thin.wire_feed_speed[0] < thick.wire_feed_speed[0]
    for s in (thick, thin):
        at = s.wire_feed_speed[0], s.speed[0], s.voltage[0]
        assert STEEL.width(*at) == pytest.approx(6e-3)
        assert np.ptp(s.voltage[s.deposit]) == 0.0


def test_the_voltage_moves_neither_speed_nor_wire_and_only_where_metal_is_laid():
    held, free = setpoints(path(), 1.05), setpoints(path(), 0.0)
    assert np.array_equal(held.speed, free.speed)
    assert np.array_equal(held.wire_feed_speed, free.wire_feed_speed)
    assert np.all(held.voltage[held.deposit] < 22.0) and np.all(held.voltage[~held.deposit] == 22.0)
    assert np.all(free.voltage == 22.0)


def test_the_limits_of_the_material_hold_and_are_counted():
    s = setpoints(path(), 1.5)
    assert np.all(s.voltage[s.deposit] == STEEL.voltage_min)
    assert s.count(Clamp.VOLTAGE) == s.deposit.sum()


def test_what_is_not_applied_leaves_the_voltage_alone():
    assert np.all(setpoints(path(), 1.1, apply=False).voltage == 22.0)


@pytest.mark.parametrize('ratio', [-1.0, 0.1, 4.0, math.nan])
def test_a_ratio_that_cannot_be_is_refused(ratio):
    with pytest.raises(SetpointError, match='width_ratio'):
        setpoints(path(), ratio)


def test_voltage_and_width_of_the_table_are_inverse():
    for feed, speed in ((0.05, 8e-3), (STEEL.wire_feed, STEEL.speed), (0.15, 15e-3)):
        voltage = STEEL.voltage_for(6.5e-3, feed, speed)
        assert STEEL.width(feed, speed, voltage) == pytest.approx(6.5e-3)
    assert STEEL.width(STEEL.wire_feed, STEEL.speed, STEEL.voltage) == STEEL.bead_width


def test_later_layers_count_less_for_they_scatter():
    estimate, steps = WidthEstimate(), []
    for _ in range(6):
        before, estimate = estimate, estimate.after(SeenWidth(6.6e-3, 0.1e-3, 6e-3))
        steps.append(estimate.ratio - before.ratio)
    assert steps[0] > 5 * steps[-1] > 0
    assert estimate.ratio == pytest.approx(1.1, abs=2 * estimate.sigma)


def test_an_uncertain_width_moves_little():
    sure, unsure = (WidthEstimate().after(SeenWidth(6.6e-3, u, 6e-3)) for u in (5e-5, 1e-3))
    assert unsure.ratio - 1 < 0.4 * (sure.ratio - 1)


@pytest.mark.parametrize(
    'bad', [{}, {'width': 0.0}, {'width': 20e-3}, {'u': math.nan}, {'u': -1.0}, {'expected': 0.0}]
)
def test_what_was_not_seen_changes_nothing_and_grows_old(bad):
    seen = dataclasses.replace(SeenWidth(6.6e-3, 5e-5, 6e-3), **bad) if bad else SeenWidth()
    assert WidthEstimate().after(seen) == WidthEstimate()
    once = WidthEstimate().after(SeenWidth(6.6e-3, 5e-5, 6e-3))
    later = once.after(seen)
    assert later.ratio == once.ratio and later.layers == 1
    assert once.sigma < later.sigma <= UNKNOWN


def test_a_layer_that_is_asked_for_twice_counts_once_and_another_job_begins_anew():
    identifier, seen = WidthIdentifier(), SeenWidth(6.6e-3, 5e-5, 6e-3)
    once = identifier.add('a', 2, seen)
    assert identifier.add('a', 2, seen) == once
    assert identifier.add('a', 3, seen) != once
    assert identifier.add('b', 3, SeenWidth()) == WidthEstimate()
