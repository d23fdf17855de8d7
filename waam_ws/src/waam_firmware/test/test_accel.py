"""Greatest acceleration of X and Y: told by `$C`, kept to by moves, holds, arcs and homing."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shaper_machine as machine
from hypothesis import given, settings
from hypothesis import strategies as st
from shaper_machine import HOLD, IDLE, Machine, target

LIMIT = 500.0  # of the machine, mm/s^2
STEP_SPEED = 2 / machine.STEPS_PER_MM / 8e-3  # mm/s: what whole steps add to a speed over 8 ms


def in_force(m: Machine) -> list[float]:
    words = dict(w.split('=', 1) for w in m.ask('$I keep').split() if '=' in w)
    return [float(v) for v in words['accel'].split(',')]


def speeds(m: Machine, begun: int = 0) -> np.ndarray:
    """mm/s (n, 3) over 8 ms each."""
    return np.diff(m.track()[begun::8], axis=0) / machine.STEPS_PER_MM / 8e-3


def steepest(m: Machine, begun: int) -> np.ndarray:
    """Greatest change of speed (3,) mm/s within 8 ms."""
    return np.abs(np.diff(speeds(m, begun), axis=0)).max(axis=0)


def test_a_setting_shows_and_survives_a_reset():
    m = Machine(home=False, max_accel_x=350.5, max_accel_y=50)
    assert in_force(m) == [350.5, 50]
    shown = ' max_accel_x=350.5 max_accel_y=50 accel_limit_x=500 accel_limit_y=500'
    assert m.ask('$L').endswith(shown)
    assert m.ask('$X') == '$X ok' and in_force(m) == [350.5, 50]
    assert m.ask('$C max_accel_x 123.45678') == '$C ok' and in_force(m) == [123.457, 50]


def test_the_longest_answers_fit_into_a_line():
    m = Machine(
        home=False, shape_x='3hump_ei', shape_x_hz=123.45, shape_x_damping=0.123, shape_y='3hump_ei',
        shape_y_hz=123.46, shape_y_damping=0.123, shape_corner_mm=0.123, wire_delay_s=0.1234, wire_lag_s=0.1234,
        wire_response_s=0.1234, wire_underfeed_ratio=0.9234, steps_per_mm_x=319.873, steps_per_mm_y=345.021,
        steps_per_mm_z=640.512, max_accel_x=123.457, max_accel_y=345.678,
    )  # fmt: skip
    assert m.ask('$L').endswith(' accel_limit_x=500 accel_limit_y=500')
    m.ask('$X')
    m.ask('$Z 123.4567 123.4567 123.4567')
    identity = m.ask('$I')
    assert identity.endswith(' corner_mm=0.123')
    # a boot id, line numbers and a clock of their most digits, the longer check, the sensors' capabilities, `clk=sync`
    more = len('@4294967295 @9007199254740992*0123456789\n,ACCEL,TEMPERATURE') + 3 * 9
    assert len(identity) + more <= 480


@pytest.mark.parametrize(
    ('setting', 'text'),
    [
        ('max_accel_x 49.999', 'E104 max_accel_x must be at least 50 mm/s^2'),
        ('max_accel_y -100', 'E104 max_accel_y must be at least 50 mm/s^2'),
        ('max_accel_x 0', 'E104 max_accel_x must be at least 50 mm/s^2'),
        ('max_accel_x 500.001', 'E105 max_accel_x: the machine has at most 500 mm/s^2'),
        ('max_accel_y 900000000', 'E105 max_accel_y: the machine has at most 500 mm/s^2'),
        ('max_accel_x', 'E107 a number is missing or malformed'),
        ('accel_limit_z 200', 'E103 no setting has this name'),
        ('accel_limit_x 6000', 'E104 accel_limit_x must lie within 50 .. 5000'),
    ],
)
def test_what_is_absurd_is_refused_and_changes_nothing(setting, text):
    m = Machine(max_accel_y=400)
    assert m.ask(f'$C {setting}') == f'$C error {text}'
    assert in_force(m) == [LIMIT, 400] and m.frame['flags'] & 8, 'homed'


def test_not_while_moves_are_queued_but_armed_and_in_alarm():
    m = Machine()
    m.send('G1 X20 F3000', 'G1 X40')
    m.tick(100)
    refused = '$C error E108 settings only in IDLE or ALARM'
    assert m.ask('$C max_accel_x 200') == refused
    assert m.ask('$P') == '$P ok'
    m.until(lambda f: f['state'] == HOLD and f['v_um_s'] == 0)
    assert m.ask('$C max_accel_x 200') == refused
    assert m.ask('$R') == '$R ok'
    m.until(lambda f: f['state'] == IDLE)
    assert m.position().tolist() == target(40, 0, 200) and in_force(m) == [LIMIT, LIMIT]
    assert m.ask('$A job') == '$A ok' and m.ask('$C max_accel_x 200') == '$C ok'


def test_each_axis_keeps_to_its_own():
    """A move takes L/v + v/a, and no axis changes its speed faster than it may; a slant by the stricter one."""
    m = Machine(max_accel_x=120)
    for words, accel in (('X60', 120.0), ('Y60', LIMIT), ('X0 Y0', 120.0 * math.sqrt(2))):
        begun = len(m.track())
        m.run(f'G1 {words} F3000')
        ticks = np.flatnonzero(np.diff(m.track()[begun - 1 :], axis=0).any(axis=1))
        length = 60 * (math.sqrt(2) if ' ' in words else 1)
        assert np.ptp(ticks) * 1e-3 == pytest.approx(length / 50 + 50 / accel, abs=0.03)
        steep = steepest(m, begun)
        assert steep[0] <= 120 * 8e-3 + STEP_SPEED and steep[1] <= LIMIT * 8e-3 + STEP_SPEED
    assert m.position().tolist() == target(0, 0, 200)


def test_an_arc_is_run_within_the_acceleration():
    """v^2/R gets at most 0.8 of it: 10 mm, 100 mm/s^2, 28.3 mm/s."""
    top = {}
    for accel in (LIMIT, 100.0):
        m = Machine(max_accel_x=accel, max_accel_y=accel)
        m.run('G1 X60 Y60 F6000')
        begun = len(m.track())
        m.run('G2 X60 Y60 I10 F6000')
        top[accel] = float(np.linalg.norm(speeds(m, begun)[:, :2], axis=1).max())
        assert steepest(m, begun)[:2].max() <= accel * 8e-3 + STEP_SPEED
    assert top[LIMIT] > 60 and top[100.0] == pytest.approx(math.sqrt(800), abs=1.0)


def test_a_hold_brakes_over_the_longer_way_and_loses_no_step():
    for accel in (LIMIT, 80.0):
        m = Machine(max_accel_x=accel)
        m.send('G1 X150 F3000')
        m.until(lambda f: f['v_um_s'] == 50_000)
        begun = m.position()[0] / machine.STEPS_PER_MM
        m.ask('$P')
        m.until(lambda f: f['state'] == HOLD and f['v_um_s'] == 0)
        way = m.position()[0] / machine.STEPS_PER_MM - begun
        assert way == pytest.approx(50**2 / (2 * accel), abs=0.2)
        m.ask('$R')
        m.until(lambda f: f['state'] == IDLE)
        assert m.position().tolist() == target(150, 0, 200)


def test_homing_runs_past_its_switch_no_farther():
    """It seeks more slowly, for behind the home switch comes the limit switch."""
    past = []
    for accel in (LIMIT, 50.0):
        m = Machine(max_accel_x=accel, max_accel_y=accel)
        m.run('G1 X30 Y30 F6000')
        begun = len(m.track())
        m.run('G28')
        assert m.position().tolist() == target(0, 0, 200)
        past.append(m.track()[begun:].min(axis=0)[:2] / machine.STEPS_PER_MM)
        at_once = 2.0  # mm/s: the axis stands as soon as its switch is found for good
        assert steepest(m, begun)[:2].max() <= max(accel * 8e-3, at_once) + STEP_SPEED
    assert past[0].max() < -1 and (past[1] >= past[0] - 0.1).all()


@settings(max_examples=8, deadline=None)
@given(st.data())
def test_ends_are_exact_whatever_the_accelerations(data):
    """With and without a shaper, changed between programs; no axis is ever steeper than it may be."""
    shaped = {'shape_x': 'mzv', 'shape_x_hz': 40.0, 'shape_y': 'zv', 'shape_y_hz': 60.0}
    m = Machine(**(shaped if data.draw(st.booleans()) else {}))
    for _ in range(2):
        limits = [data.draw(st.integers(50, 500)) for _ in 'xy']
        for axis, value in zip('xy', limits, strict=True):
            assert m.ask(f'$C max_accel_{axis} {value}').startswith('$C ok')
        begun = len(m.track())
        ends = data.draw(st.lists(st.tuples(*(st.integers(0, 3000),) * 2), min_size=2, max_size=10))
        m.run(*(f'G1 X{x / 1e2:.2f} Y{y / 1e2:.2f} F9000' for x, y in ends), 'G1 X1.25 Y2.5')
        assert m.position().tolist() == target(1.25, 2.5, 200)
        # a corner is passed within the junction deviation at once: v sqrt(2 (1 - cos)) <= sqrt(8 a d)
        jump = math.sqrt(8 * max(limits) * math.sqrt(2) * 0.02)
        assert (steepest(m, begun)[:2] <= np.array(limits) * 8e-3 + jump + STEP_SPEED).all()
