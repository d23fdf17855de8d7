import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_adapt.feed import feed_forward as ff
from waam_adapt.feed.feed_forward import SetpointError
from waam_adapt.types import split_ratio
from waam_process import bead, materials
from waam_process.grid import GridSpec
from waam_process.segment import Clamp, Kind

STEEL = materials.get('er70s-6')
LIMITS = ff.Limits.of(STEEL, (3e-3, 20e-3), (2 / 60, 12 / 60))
SPEC = GridSpec(0.0, 0.0, 0.5e-3, 60, 120)
H, W, V = 2e-3, 6e-3, 10e-3
BASE = bead.wire_feed(W, H, V, STEEL)


def path(n=20, y=15e-3, **changes):
    x = 5e-3 + 2e-3 * np.arange(n + 1)
    points = np.stack([x, np.full(n + 1, y), np.zeros(n + 1)], axis=1)
    values = {
        'index': np.arange(n), 'kind': np.full(n, int(Kind.DEPOSIT)), 'start': points[:-1],
        'end': points[1:], 'height': np.full(n, H), 'width': np.full(n, W), 'speed': np.full(n, V),
    }  # fmt: skip
    return ff.Path(**(values | changes))


def uniform(psi=0.0, residual=0.0, k_gain=0.3, flow=1.0):
    return ff.Field(SPEC, np.full(SPEC.shape, psi), np.full(SPEC.shape, residual), k_gain, flow)


def growth(p, s):
    """Height in m that the mass balance gives for these setpoints, by the table's efficiency."""
    return bead.layer_height(s.wire_feed_speed, s.speed, bead.AREA_FACTOR * p.width, STEEL)


def test_without_correction_the_plan_is_laid():
    p = path()
    s = ff.compute(p, STEEL, LIMITS, 22.0)
    assert s.speed == pytest.approx(V)
    assert s.wire_feed_speed == pytest.approx(BASE)
    assert growth(p, s) == pytest.approx(H)
    assert not s.clamps.any()


@given(st.floats(-1, 1))
def test_the_two_corrections_do_not_cancel(psi):
    """Speed alone moves; the feed stays that of the programmed speed, so the bead really changes."""
    p = path()
    s = ff.compute(p, STEEL, LIMITS, 22.0, uniform(psi))
    assert s.speed == pytest.approx(V * (1 + 0.3 * psi))
    assert s.wire_feed_speed == pytest.approx(BASE)
    assert growth(p, s) == pytest.approx(H / (1 + 0.3 * psi))


@given(st.floats(0.5, 1.7), st.floats(0.05, 0.3))
def test_wanted_height_is_laid_once_however_it_is_split(ratio, k_gain):
    """From the law's split to metal: neither cancelled nor doubled, with or without a residual."""
    psi, residual = split_ratio(np.array(ratio), np.array(H), k_gain)
    p = path()
    s = ff.compute(p, STEEL, LIMITS, 22.0, uniform(float(psi), float(residual), k_gain))
    assert growth(p, s) == pytest.approx(ratio * H, rel=1e-6)


def test_also_when_the_machine_cannot_drive_the_wanted_speed():
    narrow = ff.Limits.of(STEEL, (9e-3, 10.5e-3), (2 / 60, 12 / 60))
    p = path()
    for psi, bit in ((-1.0, Clamp.SPEED_LOW), (1.0, Clamp.SPEED_HIGH)):
        s = ff.compute(p, STEEL, narrow, 22.0, uniform(psi))
        assert growth(p, s) == pytest.approx(H / (1 + 0.3 * psi))
        assert (s.clamps & int(bit) > 0).all()
        assert s.count(bit) == 20


@pytest.mark.parametrize('flow', [0.9, 1.2])
def test_heat_and_flow_factor_multiply_the_feed(flow):
    s = ff.compute(path(), STEEL, LIMITS, 22.0, uniform(-0.5, flow=flow), heat_factor=0.85)
    assert s.wire_feed_speed == pytest.approx(BASE * 0.85 * flow)
    assert (s.heat_factor, s.flow_factor) == (0.85, flow)


def test_monitor_writes_the_terms_and_applies_nothing():
    s = ff.compute(path(), STEEL, LIMITS, 22.0, uniform(-0.8, 3e-4, flow=1.2), apply=False)
    assert s.speed == pytest.approx(V)
    assert s.wire_feed_speed == pytest.approx(BASE)
    assert s.psi == pytest.approx(-0.8)
    assert s.residual_height == pytest.approx(3e-4)
    assert s.flow_factor == 1.0


def test_feed_limits_are_kept_and_counted():
    thin, thick = (
        path(height=np.full(20, 0.5e-3)),
        path(height=np.full(20, 3e-3), speed=np.full(20, 19e-3)),
    )
    low = ff.compute(thin, STEEL, LIMITS, 22.0)
    assert low.wire_feed_speed == pytest.approx(2 / 60)
    assert low.speed == pytest.approx(V)  # nothing is applied without a correction
    assert low.count(Clamp.FEED_LOW) == 20
    high = ff.compute(thick, STEEL, LIMITS, 22.0)
    assert high.wire_feed_speed == pytest.approx(12 / 60)
    assert high.count(Clamp.FEED_HIGH) == 20


def test_speed_makes_up_for_a_feed_at_its_limit_when_corrections_are_applied():
    p = path(height=np.full(20, 0.5e-3))
    s = ff.compute(p, STEEL, LIMITS, 22.0, uniform())
    assert growth(p, s) == pytest.approx(0.5e-3)
    assert s.count(Clamp.FEED_LOW) == 20
    p = path(height=np.full(20, 0.2e-3))
    s = ff.compute(p, STEEL, LIMITS, 22.0, uniform())
    assert s.speed == pytest.approx(20e-3)
    assert s.count(Clamp.SPEED_HIGH) == 20


def test_voltage_limit_and_saturated_psi_are_counted():
    s = ff.compute(path(), STEEL, LIMITS, 45.0, uniform(1.0))
    assert s.voltage == pytest.approx(30.0)
    assert s.count(Clamp.VOLTAGE) == s.count(Clamp.PSI) == 20


def test_psi_is_the_mean_along_the_segment():
    psi = np.tile((SPEC.x / SPEC.x.max())[None, :], (SPEC.rows, 1))
    p = path()
    s = ff.compute(p, STEEL, LIMITS, 22.0, ff.Field(SPEC, psi, 0 * psi, 0.3))
    middle = 0.5 * (p.start[:, 0] + p.end[:, 0])
    assert s.psi == pytest.approx(middle / SPEC.x.max())


def test_segments_off_the_map_are_laid_as_planned():
    s = ff.compute(path(y=0.5), STEEL, LIMITS, 22.0, uniform(-1.0))
    assert s.speed == pytest.approx(V)
    assert not s.psi.any()


def test_only_depositing_segments_are_marked():
    kinds = np.array([Kind.IDLE, Kind.DEPOSIT, Kind.SCAN, Kind.DWELL] * 5)
    idle = kinds != Kind.DEPOSIT
    speed = np.where(kinds == Kind.DWELL, 0.0, np.where(idle, 50e-3, V))
    s = ff.compute(
        path(kind=kinds, speed=speed, height=np.where(idle, 0.0, H)), STEEL, LIMITS, 22.0
    )
    assert (s.deposit == ~idle).all()
    assert not s.clamps[idle].any()


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('height', math.nan),
        ('height', 0.0),
        ('width', -1e-3),
        ('speed', math.inf),
        ('speed', 0.0),
        ('kind', 7),
    ],
)
def test_bad_segment_is_refused_naming_index_and_field(name, value):
    p = path()
    array = getattr(p, name).copy()
    array[7] = value
    with pytest.raises(SetpointError, match=f'segment 7: {name}'):
        ff.compute(path(**{name: array}), STEEL, LIMITS, 22.0)


@pytest.mark.parametrize('name', ['start', 'end'])
def test_a_point_that_is_no_number_is_refused(name):
    points = getattr(path(), name).copy()
    points[3, 1] = math.nan
    with pytest.raises(SetpointError, match=f'segment 3: {name}'):
        ff.compute(path(**{name: points}), STEEL, LIMITS, 22.0)


@pytest.mark.parametrize('factor', [math.nan, 0.0, 1.1])
def test_heat_factor_out_of_range(factor):
    with pytest.raises(SetpointError, match='heat_factor'):
        ff.compute(path(), STEEL, LIMITS, 22.0, heat_factor=factor)


@pytest.mark.parametrize(
    ('changes', 'word'),
    [
        ({'psi': 1.5}, 'psi'), ({'psi': math.nan}, 'psi'), ({'residual': math.inf}, 'residual_height'),
        ({'k_gain': math.nan}, 'k_gain'), ({'flow': 0.0}, 'flow_factor'),
    ],
)  # fmt: skip
def test_a_correction_that_makes_no_sense(changes, word):
    with pytest.raises(SetpointError, match=word):
        uniform(**changes)


def test_limits_that_exclude_each_other():
    with pytest.raises(SetpointError, match='wire feed limits'):
        ff.Limits.of(STEEL, (3e-3, 20e-3), (0.5, 0.6))
