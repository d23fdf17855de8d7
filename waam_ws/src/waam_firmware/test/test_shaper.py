"""The input shapers themselves: impulses, taps, what they leave of a vibration, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shaper_loop as loop
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shaper_loop import ONE, TICK, Axis

SHAPES = loop.TYPES[1:]
# residual vibration at the tuned frequency and 15 % off it, undamped impulses of the literature at most
AT_TUNED = {
    'zv': 1e-5,
    'zvd': 1e-5,
    'mzv': 1e-5,
    'ei': 0.0501,
    '2hump_ei': 1e-5,
    '3hump_ei': 0.0501,
}
QUICK = settings(max_examples=60, deadline=None, derandomize=True)
AXES = st.builds(Axis, st.sampled_from(SHAPES), st.floats(5, 200), st.floats(0, 0.2))
ANY_AXIS = st.one_of(AXES, st.just(Axis()))


def tuned(x: Axis, y: Axis | None = None) -> loop.Figures:
    """In force; examples that the controller refuses are no examples."""
    try:
        return loop.start(x, y)
    except ValueError:
        assume(False)
        raise


def test_the_check_of_the_source():
    """35 Hz, damping 0.05: 14.304 and 28.607 ms, amplitudes of ZV and ZVD with damping."""
    amplitude, time = loop.impulses(Axis('zv', 35.0, 0.05))
    assert time * 1e3 == pytest.approx([0, 14.304], abs=1e-3)
    assert amplitude == pytest.approx([0.5392, 0.4608], abs=1e-4)
    amplitude, time = loop.impulses(Axis('zvd', 35.0, 0.05))
    assert time * 1e3 == pytest.approx([0, 14.304, 28.607], abs=1e-3)
    assert amplitude == pytest.approx([0.2908, 0.4969, 0.2123], abs=1e-4)


@QUICK
@given(AXES)
def test_impulses_sum_to_one_and_ascend(axis):
    amplitude, time = loop.impulses(axis)
    assert math.fsum(amplitude) == pytest.approx(1.0, abs=1e-6) and (amplitude > 0).all()
    assert time[0] == 0.0 and (np.diff(time) > 0).all()
    halves = {'zv': 1, 'zvd': 2, 'mzv': 1.5, 'ei': 2, '2hump_ei': 3, '3hump_ei': 4}[axis.type]
    period = 1 / (axis.hz * math.sqrt(1 - axis.damping**2))
    assert time[-1] == pytest.approx(0.5 * halves * period, rel=1e-5)


@pytest.mark.parametrize('shape', SHAPES)
@QUICK
@given(hz=st.floats(5, 150), damping=st.floats(0, 0.2), off=st.floats(-0.15, 0.15))
def test_residual_vibration(shape, hz, damping, off):
    """At the tuned frequency nothing is left (of EI and 3HUMP_EI the 5 % that they allow themselves), and within
    15 % of it at most 25 %; the taps in whole ticks are as good as the impulses."""
    tuned(Axis(shape, hz, damping))
    ago, weight = loop.taps(0)
    assert loop.residual(ago * TICK, weight, hz, damping) <= AT_TUNED[shape]
    assert loop.residual(ago * TICK, weight, hz * (1 + off), damping) <= 0.25


@pytest.mark.parametrize(
    ('shape', 'most'), [('zvd', 0.065), ('ei', 0.05), ('2hump_ei', 0.05), ('3hump_ei', 0.05)]
)
def test_the_robust_ones_15_percent_off(shape, most):
    worst = 0.0
    for hz in (20, 35, 50, 70, 100):
        for damping in (0.0, 0.05, 0.1):
            loop.start(Axis(shape, hz, damping))
            ago, weight = loop.taps(0)
            for off in (0.85, 1.15):
                worst = max(worst, loop.residual(ago * TICK, weight, hz * off, damping))
    assert worst <= most


@QUICK
@given(ANY_AXIS, ANY_AXIS)
def test_all_axes_have_the_same_delay(x, y):
    """Weights sum up exactly; the mean delays agree within a fiftieth of a tick: 1 um at 50 mm/s."""
    assume(x.type != 'none' or y.type != 'none')
    figures = tuned(x, y)
    for channel in range(4):
        ago, weight = loop.taps(channel)
        assert weight.sum() == ONE and (weight > 0).all()
        assert ago.max() <= figures.span < 128
        if channel < 3:
            mean = (ago * weight).sum() / ONE * TICK
            assert mean == pytest.approx(figures.delay, abs=0.02 * TICK)


@QUICK
@given(ANY_AXIS, ANY_AXIS, st.integers(0, 2**32 - 1))
def test_random_motion_ends_exactly(x, y, seed):
    """Any motion: exact after span ticks of rest, in between never outside the range of the past."""
    figures = tuned(x, y)
    dice = np.random.default_rng(seed)
    way = np.cumsum(dice.integers(-64, 65, (300, 3)) * (dice.random((300, 1)) < 0.7), axis=0)
    planned = np.concatenate([way, np.repeat(way[-1:], figures.span + 1, axis=0)])
    shaped = loop.run(planned)
    assert (shaped[-1] == way[-1]).all() and loop.settled()
    if x.type == y.type == 'none':
        assert (shaped == planned).all()
    past = np.concatenate([np.zeros((figures.span, 3), int), planned])
    windows = np.lib.stride_tricks.sliding_window_view(past, figures.span + 1, axis=0)
    assert (shaped >= windows.min(axis=-1)).all() and (shaped <= windows.max(axis=-1)).all()


def plant(path: np.ndarray, hz: float, damping: float) -> np.ndarray:
    """Position of a mode driven by the position `path` (n,), one value per tick, linear in between: exact solution."""
    omega = 2 * np.pi * hz
    pole = omega * (-damping + 1j * math.sqrt(1 - damping**2))
    step = np.exp(pole * TICK)
    # x - u = z + z*, z' = pole z - c u', with u' constant within a tick
    c = -pole.conjugate() / (pole - pole.conjugate())
    z, out = 0j, np.empty(len(path))
    for k in range(len(path)):
        rate = (path[k] - path[k - 1]) / TICK if k else 0.0
        z = z * step + c * rate * (1 - step) / pole
        out[k] = path[k] + 2 * z.real
    return out


@pytest.mark.parametrize('shape', SHAPES)
def test_a_move_leaves_the_plant_at_rest(shape):
    """A trapezoid of 20 mm on a second-order plant: residual vibration shaped to unshaped, in hundredths of a step."""
    hz, damping = 37.3, 0.06
    figures = loop.start(Axis(shape, hz, damping), Axis('zv', 50.0))
    rate = np.clip(np.minimum(np.arange(1, 491), 490 - np.arange(490)) * 0.5, 0, 40.8)
    way = np.round(np.cumsum(rate) * TICK * 32000).astype(int)
    planned = np.concatenate([way, np.full(300, way[-1])])
    shaped = loop.run(np.stack([planned, 0 * planned, 0 * planned], axis=1))[:, 0]
    left = []
    for path in (planned, shaped):
        off = plant(path / 32000, hz, damping) - path / 32000
        left.append(np.abs(off[len(way) + figures.span :]).max())
    assert left[0] > 0.002 and left[1] <= (AT_TUNED[shape] + 0.04) * left[0]


@QUICK
@given(ANY_AXIS, ANY_AXIS, st.floats(1, 50), st.floats(0, 500), st.floats(0, math.pi))
def test_a_corner_is_rounded_within_the_bound(x, y, speed, accel, turn):
    """Straight in, straight out, with speed rising away from the corner: nearest distance of the shaped path."""
    figures = tuned(x, y)
    t = np.arange(-150, 151) * TICK
    along = (
        np.sign(t) * (speed * np.abs(t) + 0.5 * accel * t**2) * 320 * 100
    )  # hundredths of a step
    before, after = np.array([1.0, 0.0, 0.0]), np.array([math.cos(turn), math.sin(turn), 0.0])
    path = np.where(t[:, None] < 0, along[:, None] * before, along[:, None] * after)
    path -= path[0]
    shaped = loop.run(np.round(path).astype(int)) / 32000
    corner = path[150] / 32000
    nearest = np.linalg.norm(shaped[150:] - corner, axis=1).min()
    bound = 2 * speed * math.sin(turn / 2) * figures.corner + accel * figures.corner2
    tick = (speed + accel * 0.15) * TICK  # the nearest point lies between two ticks
    assert nearest <= bound + tick + 1e-3


@pytest.mark.parametrize(
    ('x', 'text'),
    [
        (Axis('zv', 4.9), 'shape_x_hz: out of range'),
        (Axis('zv', 201.0), 'shape_x_hz: out of range'),
        (Axis('zv', math.nan), 'shape_x_hz: out of range'),
        (Axis('zv', 50.0, 0.21), 'shape_x_damping: out of range'),
        (Axis('zv', 50.0, -0.01), 'shape_x_damping: out of range'),
        (Axis('3hump_ei', 15.0), 'slower than the lead of the wire'),
        (Axis('ei', 8.0), 'slower than the lead of the wire'),
    ],
)
def test_absurd_settings_are_refused(x, text):
    with pytest.raises(ValueError, match=text):
        loop.start(x)
    assert loop.library().shaper_loop_set(b'shape_x', 7.0) == b'out of range'
    assert loop.library().shaper_loop_set(b'shape_z', 1.0) == b'unknown'
    assert loop.library().shaper_loop_set(b'shape_xx', 1.0) == b'unknown'


def test_too_long_a_shaper_is_refused_whatever_the_lead():
    with pytest.raises(ValueError, match='too long'):
        loop.start(Axis('3hump_ei', 6.0), most=1.0)
