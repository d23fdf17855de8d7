"""Programs, holds, stops and homing of the whole controller with the input shaper on, beside the same without it."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shaper_machine as machine
from shaper_machine import HOLD, IDLE, Machine, executed_at, target

SHAPED = {'shape_x': 'mzv', 'shape_x_hz': 40.0, 'shape_y': 'ei', 'shape_y_hz': 30.0}
UNBOUND = SHAPED | {'shape_corner_mm': 1.0}  # corners are passed as without a shaper
SPAN_MS, DELAY_MS = 34, 14.0  # of both together
ARC, GAS = 1, 2
PROGRAM = (
    'G1 X20 Y10 F3000',
    'G1 X20 Y25',
    'G2 X30 Y35 I10',
    'G1 X24 Y27 Z196 F1200',
    'G4 P0.05',
    'G1 X25.5',
)


@pytest.fixture(scope='module')
def plain():
    """The program without a shaper."""
    m = Machine()
    m.run(*PROGRAM)
    return m


@pytest.fixture
def shaped():
    m = Machine(**SHAPED)
    yield m
    m.close()


def test_the_end_is_exact_and_the_time_is_longer_by_the_span(plain):
    """Every stop of the program waits for the shaped motion, and no line is told before its motion is at its end."""
    shaped = Machine(**UNBOUND)
    shaped.run(*PROGRAM)
    assert shaped.position().tolist() == plain.position().tolist() == target(25.5, 27, 196)
    late = [
        (executed_at(shaped.frames, n) - executed_at(plain.frames, n)) / 1000 for n in range(2, 8)
    ]
    assert late[:4] == [SPAN_MS] * 4  # up to the dwell
    assert SPAN_MS <= late[4] <= SPAN_MS + 1
    assert 2 * SPAN_MS <= late[5] <= 2 * SPAN_MS + 2


def test_shaped_path_stays_near_the_path(plain, shaped):
    """Apart from the delay, nearer than 0.03 mm anywhere to the ticks of the unshaped path, which are 0.05 mm apart."""
    shaped.run(*PROGRAM)
    path, way = plain.track(), shaped.track()[2800::7]
    nearest = [np.linalg.norm(path - p, axis=1).min() for p in way]
    assert max(nearest) / machine.STEPS_PER_MM <= 0.03


def corner_off(corner_mm: float, speed: float) -> tuple[float, float]:
    """Nearest distance (mm) from a right angle, and time (s) of the two legs of 20 mm; F in mm/s."""
    m = Machine(**SHAPED | {'shape_corner_mm': corner_mm})
    m.run('G0 X20 Y20')
    begun = len(m.track())
    m.run(f'G1 X40 F{60 * speed:g}', 'G1 Y40')
    track = m.track()[begun:]
    off = np.linalg.norm(track[:, :2] - target(40, 20), axis=1).min() / machine.STEPS_PER_MM
    assert track[-1].tolist() == target(40, 40, 200)
    return float(off), len(track) * 1e-3


def test_a_corner_is_rounded_by_no_more_than_asked():
    """At any speed; a corner and the stop after it take less than 0.2 s for it."""
    for speed in (10.0, 50.0):
        free, quick = corner_off(1.0, speed)
        for allowed in (0.005, 0.02):
            off, time = corner_off(allowed, speed)
            assert off <= allowed + 1.5 / machine.STEPS_PER_MM < free + 0.01
            assert off < free and time <= quick + 0.2


def test_without_a_shaper_the_answer_says_nothing_of_it():
    m = Machine(home=False)
    assert ' shape=' not in m.ask('$I') and 'SHAPE' in m.ask('$I')
    assert m.ask('$C shape_x_hz 40') == '$C ok'


def test_settings_show_and_survive_a_reset(shaped):
    """They are refused by name, and changed neither by a refusal nor by a reset."""
    shown = ' shape=mzv:40:0.1,ei:30:0.1 corner_mm=0.02'
    assert shaped.ask('$I keep').endswith(shown)
    wire = ' wire_delay_s=0.03 wire_lag_s=0.065 wire_response_s=0.02 wire_underfeed_ratio=0.9'
    axes = ' steps_per_mm_x=320 steps_per_mm_y=320 steps_per_mm_z=320'
    accel = ' max_accel_x=500 max_accel_y=500 accel_limit_x=500 accel_limit_y=500'
    assert shaped.ask('$L') == '$L' + shown + wire + axes + accel
    assert (
        shaped.ask('$C shape_y 4')
        == '$C ok delay_ms=14.02 span_ms=34 corner_um=6.94,37.25 corner_mm_s=2.88'
    )
    for setting, text in [
        ('shape_x 7', 'E104 shape_x must be a whole number within 0 .. 6'),
        ('shape_x 1.5', 'E104 shape_x must be a whole number within 0 .. 6'),
        ('shape_x mzv', 'E107 a number is missing or malformed'),
        ('shape_x_hz 4', 'E104 shape_x_hz must lie within 5 .. 200'),
        ('shape_y_hz 8', 'E105 shape_y_hz: the shaper is slower than the lead of the wire'),
        ('shape_y_damping 0.3', 'E104 shape_y_damping must lie within 0 .. 0.2'),
        ('shape_corner_mm 0.004', 'E104 shape_corner_mm must lie within 0.005 .. 1'),
        ('shape_corner_mm 1.1', 'E104 shape_corner_mm must lie within 0.005 .. 1'),
        ('shape_z 1', 'E103 no setting has this name'),
    ]:
        assert shaped.ask(f'$C {setting}') == f'$C error {text}'
    assert shaped.ask('$X') == '$X ok' and shaped.ask('$I').endswith(shown)
    shaped.next = 1
    shaped.send('G28')
    shaped.tick(2)
    assert shaped.ask('$C shape_x 0').startswith('$C error E108')


def test_hold_stands_exactly_and_goes_on(shaped):
    shaped.send('G1 X60 F3000', 'G1 X60 Y40')
    shaped.tick(600)
    assert shaped.ask('$P') == '$P ok'
    shaped.until(lambda f: f['state'] == HOLD and f['v_um_s'] == 0)
    stood = shaped.position()
    assert (shaped.tick(50) == stood).all() and 0 < stood[0] < target(60)[0]
    assert shaped.frame['x_um'] == round(stood[0] / 0.320)
    assert shaped.ask('$R') == '$R ok'
    shaped.until(lambda f: f['state'] == IDLE)
    assert shaped.position().tolist() == target(60, 40, 200)


def test_stop_ends_smoothly_and_the_next_move_is_exact(shaped):
    shaped.send('G1 X60 F3000')
    shaped.tick(600)
    shaped.ask('$S')
    shaped.until(lambda f: f['state'] == IDLE)
    stood = shaped.position()
    assert (shaped.tick(50) == stood).all()
    assert shaped.frame['executed'] == 1
    assert shaped.ask(f'$L {shaped.next}') == '$L ok'
    shaped.run('G1 X10 Y5 F3000')
    assert shaped.position().tolist() == target(10, 5, 200)


def test_override_acts_while_the_axes_keep_their_acceleration(shaped):
    begun = len(shaped.track())
    shaped.send('G1 X60 Y30 F1200')
    shaped.tick(300)
    shaped.ask('$V 2000 1000')
    shaped.tick(20 + SPAN_MS + 40)
    assert shaped.frame['v_um_s'] == 40_000
    shaped.until(lambda f: f['state'] == IDLE)
    assert shaped.position().tolist() == target(60, 30, 200)
    speeds = np.diff(shaped.track()[begun::4, :2], axis=0) / machine.STEPS_PER_MM / 4e-3
    step = 2 / machine.STEPS_PER_MM / 4e-3  # of a speed, by whole steps
    assert np.abs(np.diff(speeds, axis=0)).max() <= 500 * 4e-3 + step


def test_homing_is_not_shaped(plain):
    """To the tick where it was."""
    m = Machine(**SHAPED)
    n = len(m.track())
    assert executed_at(m.frames, 1) == executed_at(plain.frames, 1)
    assert (m.track() == plain.track()[:n]).all()


def test_jogs_add_up_while_the_last_one_ends(shaped):
    """A jog that comes while the motion of the one before is under way is taken."""
    assert shaped.ask('$J 2 0 0 3000') == '$J ok'
    shaped.until(lambda f: f['free'] == 64)
    assert shaped.frame['state'] == 1
    assert shaped.ask('$J 1 1 -1 3000') == '$J ok'
    shaped.until(lambda f: f['state'] == IDLE)
    assert shaped.position().tolist() == target(3, 1, 199)


def moving(m: Machine) -> np.ndarray:
    """Of every tick, whether an axis has moved."""
    return np.concatenate([[False], (np.diff(m.track(), axis=0) != 0).any(axis=1)])


def outputs(m: Machine) -> np.ndarray:
    return np.concatenate([s['outputs'] for s in m.samples])


def test_the_arc_is_struck_and_ended_at_rest(shaped):
    """Not before the move ends, with the motion at rest while the crater is filled, and not in HOLD for running dry."""
    shaped.ask('$A test')
    shaped.run('G1 X10 F3000', 'M3 W6000 S22', 'G1 X20 F600', 'M5', 'G1 X25 F3000')
    arc, moves = outputs(shaped) & ARC != 0, moving(shaped)
    on, off = np.flatnonzero(np.diff(arc.astype(int)) != 0) + 1
    x = shaped.track()[:, 0]
    assert x[on] == target(10)[0] and x[off - 1] == target(20)[0]
    assert not moves[on : on + 30].any()  # the strike
    ended = on + np.flatnonzero(moves[on:off])[-1]
    assert off - ended > 200  # crater and burn-back after the last step
    assert shaped.lines.count('! HOLD E203 the queue ran dry with the arc on') == 0


def fed(m: Machine) -> np.ndarray:
    """Length of wire up to every tick (mm), at the arc: 30 ms after the command, motor of 65 ms."""
    wire = np.concatenate([s['wire_cmd'] for s in m.samples]) * 1e3
    motor, out = 0.0, np.empty(len(wire))
    for k, command in enumerate(np.concatenate([np.zeros(30), wire])[: len(wire)]):
        motor += (command - motor) * (1 - math.exp(-1e-3 / 0.065))
        out[k] = motor
    return np.cumsum(out) * 1e-3


def bead(*lines: str, head: str = 'M3 W4800 S22', **settings) -> tuple[np.ndarray, np.ndarray]:
    """x (mm) and wire at the arc (mm per tick) of every tick with the arc on."""
    m = Machine(**settings)
    m.ask('$A test')
    m.run('G0 X10', *head.split('|'), *lines, 'M5')
    lit = outputs(m) & ARC != 0
    return m.track()[lit, 0] / machine.STEPS_PER_MM, np.diff(fed(m), prepend=0)[lit]


def misplaced(x: np.ndarray, wire: np.ndarray, wanted: np.ndarray) -> tuple[float, float]:
    """Missing in all, and wrong in place in both directions, mm of wire, between X 12 and 41."""
    inside = (x > 12) & (x < 41)
    error = (wire - wanted)[inside]
    return float(abs(error.sum())), float(np.abs(error).sum())


def test_the_wire_changes_where_the_shaped_motion_is():
    """Steps of W in a bead: what the lead leaves of them is the same with and without a shaper."""
    lines = [f'G1 X{10 + 8 * i} W{w} F900' for i, w in enumerate((4800, 7200, 4800, 7200), 1)]
    errors = []
    for settings in ({}, SHAPED):
        x, wire = bead(*lines, **settings)
        wanted = np.where(np.floor((x - 10) / 8) % 2 == 0, 80.0, 120.0) * 1e-3
        errors.append(misplaced(x, wire, wanted))
    print(errors)
    assert errors[1][0] <= errors[0][0] + 0.1 and errors[1][1] <= errors[0][1] + 0.1
    assert errors[0][1] < 5.0
