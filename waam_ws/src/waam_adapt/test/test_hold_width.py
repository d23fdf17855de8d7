"""Bead width held by the voltage, from bead to bead."""

import math

import numpy as np
import pytest

from waam_adapt.hold.width import WidthControl, WidthSettings

SETTINGS = WidthSettings(width=7e-3, voltage=22.0, low=16.0, high=30.0)


def bead(voltage, factor=1.0, exponent=0.35):
    """A process that answers less than the equation says."""
    return 7e-3 * factor * (voltage / 22.0) ** exponent


@pytest.mark.parametrize('factor', [0.94, 1.08])
def test_a_wrong_width_is_taken_away_within_three_beads(factor):
    control = WidthControl(SETTINGS)
    for _ in range(3):
        control.add(bead(control.voltage, factor), 0.05e-3)
    assert bead(control.voltage, factor) == pytest.approx(7e-3, rel=0.01)


def test_later_beads_count_less_for_they_scatter():
    control = WidthControl(SETTINGS)
    steps = []
    for _ in range(6):
        before = control.voltage
        steps.append(abs(math.log(control.add(6.9e-3, 0.1e-3) / before)))
    assert steps[0] > 1.5 * steps[-1] > 0


def test_an_uncertain_width_moves_little():
    sure, unsure = WidthControl(SETTINGS), WidthControl(SETTINGS)
    sure.add(6.5e-3, 0.05e-3)
    unsure.add(6.5e-3, 1e-3)
    assert unsure.voltage - 22.0 < 0.4 * (sure.voltage - 22.0)


def test_limits_hold_and_nothing_winds_up():
    control = WidthControl(SETTINGS)
    for _ in range(20):
        control.add(4e-3, 0.05e-3)
    assert control.voltage == 30.0 and control.limited
    control.add(8e-3, 0.05e-3)
    assert control.voltage < 30.0 and not control.limited


@pytest.mark.parametrize('bad', [(np.nan, 1e-4), (7e-3, np.nan), (-1.0, 1e-4), (6e-3, -1.0)])
def test_what_was_not_seen_changes_nothing(bad):
    control = WidthControl(SETTINGS)
    assert control.add(*bad) == 22.0


def test_settings_that_exclude_each_other_are_refused():
    with pytest.raises(ValueError, match='voltage 40 V, limits 16 .. 30 V'):
        WidthSettings(7e-3, 40.0, 16.0, 30.0)
