"""What a law asks for depends on how the passes of a layer lie on those below."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_beads import CORNER, LENGTH, PITCH, W, pad, refined, zigzag

from waam_adapt.beads import alignment
from waam_adapt.identify.identification import Identifier
from waam_adapt.types import BeadDeviation


def moved(x: float = 0.0, y: float = 0.0, turn: int = 0) -> tuple[np.ndarray, ...]:
    return tuple(p + np.array([x, y]) for p in zigzag(turn))


def ring(radius: float, points: int = 200) -> np.ndarray:
    a = np.linspace(0.0, 2 * np.pi, points)
    return 30e-3 + radius * np.stack([np.cos(a), np.sin(a)], -1)


@given(st.floats(0.0, 0.5 * PITCH), st.integers(0, 1), st.floats(-1e-3, 1e-3))
def test_the_offset_is_measured_across_the_passes_whichever_way_they_go(aside, turn, ahead):
    off = alignment.offset(moved(ahead, aside, turn), zigzag(), W)
    assert off == pytest.approx(aside / W, abs=1e-6)


def test_rings_that_grow_from_layer_to_layer_do_not_lie_on_each_other():
    one, next_one = (
        tuple(ring(r) for r in np.array([6e-3, 10e-3, 14e-3]) + more) for more in (0, 1.5e-3)
    )
    assert alignment.offset(one, one, W) < 0.01
    assert alignment.offset(next_one, one, W) == pytest.approx(1.5e-3 / W, abs=0.01)


def test_passes_across_those_below_do_not_lie_on_them():
    across = tuple(
        CORNER + np.array([[x, 0.0], [x, 7 * PITCH]]) for x in np.arange(2e-3, LENGTH, PITCH)
    )
    assert alignment.offset(across, zigzag(), W) > alignment.OFF


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_the_farther_off_the_less_is_answered_within_bounds(one, other):
    near, far = (alignment.gain(v) for v in sorted((one, other)))
    assert 1.0 <= far <= near <= alignment.MOST


def asked(below, **changes) -> BeadDeviation:
    """What the job believes of a layer above `below`; None: its first layer."""
    who = Identifier(watch_beads=True)
    if below is not None:
        who.start('job', 1)
        who.prepare(pad(0.5e-3, paths=below))
    who.start('job', 2)
    return who.prepare(pad(0.5e-3, error=0.2e-3, **changes)).learned


def test_a_layer_on_the_passes_below_asks_for_more_than_one_between_them():
    assert asked(zigzag()).gain_factor == alignment.MOST
    assert asked(moved(y=0.5 * PITCH)).gain_factor == 1.0


def test_nothing_is_assumed_of_a_first_layer_nor_of_programs_of_others():
    assert asked(None).gain_factor == 1.0
    assert asked(zigzag(), ratio_high=2.0).gain_factor == 1.0


def test_the_passes_of_another_job_are_not_those_below():
    who = Identifier(watch_beads=True)
    who.start('job', 1)
    who.prepare(pad(0.5e-3))
    who.start('another', 2)
    assert who.prepare(pad(0.5e-3)).learned.gain_factor == 1.0


def test_the_setpoints_follow_the_factor():
    def middle(factor: float) -> float:
        learned = BeadDeviation(np.zeros((28, 40)), gain_factor=factor)
        x = refined(replace(pad(0.5e-3, error=0.2e-3), learned=learned), gain=0.8)
        return float(x[30:50, 40:80].mean())

    assert [middle(f) - 1 for f in (1.0, 1.1, 1.2)] == pytest.approx(
        [0.8 * f * 0.1 for f in (1.0, 1.1, 1.2)], abs=4e-3
    )
