"""The process control in whole jobs of the laboratory. The cell is quiet but for the wanders that a test puts in."""

import math
from pathlib import Path

import numpy as np
import pytest

from waam_lab import parts, run

WANDERS = {'arc_tip_wander': 1.2e-3, 'arc_feed_wander': 0.04}


@pytest.fixture(scope='module')
def laid(tmp_path_factory):
    folder: Path = tmp_path_factory.mktemp('process')

    def lay(value: str = 'none', cell: dict = WANDERS, **control):
        overrides = {'cell': cell, 'process_control': {'value': value, **control}}
        made = {'layers': 1, 'loop_mode': 'open_loop', 'overrides': overrides, 'preset': 'gentle'}
        return run(parts.job(folder, 'block', 101, **made))

    return lay


@pytest.fixture(scope='module')
def free(laid):
    return laid()


def test_tip_and_wire_that_wander_are_seen_in_the_current(laid, free):
    calm = laid(cell={})
    assert calm.process_variance['current'] < 0.5 * free.process_variance['current']


@pytest.mark.parametrize('value', ['current', 'heat_input'])
def test_the_value_is_held(laid, free, value):
    held = laid(value)
    assert held.process_variance[value] < 0.6 * free.process_variance[value]
    assert not held.failed and held.arcs_lost == 0


def test_speed_and_wire_together_leave_the_metal_alone(laid, free):
    """The wire of the layer is what it was, although feed and speed were moved."""
    held = laid('current')
    assert held.time != free.time
    assert held.wire == pytest.approx(free.wire, rel=0.02)
    assert held.mean == pytest.approx(free.mean, abs=0.06e-3)


def test_switched_off_nothing_is_different(laid):
    plain, off = laid(cell={}), laid('none', cell={}, ki=4.0)
    assert (plain.rms, plain.time, plain.wire) == (off.rms, off.time, off.wire)


def test_figures_are_there_without_an_arc():
    from waam_lab.process import ProcessTrace

    assert all(math.isnan(v) for v in ProcessTrace().variance().values())
    assert np.size(ProcessTrace().values()['power']) == 0
