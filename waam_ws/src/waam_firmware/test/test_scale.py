"""Steps per mm of each axis: told by `$C`, exact at every end, true on a machine that takes them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shaper_machine import Machine

UNEQUAL = (319.873, 345.021, 640.5)
X_MOST, Z_MOST = 385.0, 770.0


def told(*steps: float) -> dict[str, float]:
    return {f'steps_per_mm_{axis}': v for axis, v in zip('xyz', steps, strict=True)}


def shown(m: Machine) -> list[float]:
    words = dict(w.split('=', 1) for w in m.ask('$I keep').split() if '=' in w)
    return [float(v) for v in words['spmm'].split(',')]


def test_a_setting_shows_and_survives_a_reset():
    m = Machine(home=False, **told(*UNEQUAL))
    assert shown(m) == list(UNEQUAL)
    assert ' steps_per_mm_x=319.873 steps_per_mm_y=345.021 steps_per_mm_z=640.5 ' in m.ask('$L')
    assert m.ask('$X') == '$X ok' and shown(m) == list(UNEQUAL)


@pytest.mark.parametrize(
    ('setting', 'text'),
    [
        ('steps_per_mm_x 9.999', 'E104 steps_per_mm_x must lie within 10 .. 2000'),
        ('steps_per_mm_y 2001', 'E104 steps_per_mm_y must lie within 10 .. 2000'),
        ('steps_per_mm_z -320', 'E104 steps_per_mm_z must lie within 10 .. 2000'),
        ('steps_per_mm_x 385.001', 'E105 steps_per_mm_x: at 200 mm/s there are pulses for at most 385'),
        ('steps_per_mm_z 771', 'E105 steps_per_mm_z: at 100 mm/s there are pulses for at most 770'),
        ('steps_per_mm_x', 'E107 a number is missing or malformed'),
        ('steps_per_mm_x 1e2', 'E102 too many arguments'),
        ('steps_per_mm_w 320', 'E103 no setting has this name'),
        ('steps_per_mm 320', 'E103 no setting has this name'),
    ],
)  # fmt: skip
def test_what_is_absurd_is_refused_and_changes_nothing(setting, text):
    m = Machine()
    assert m.ask(f'$C {setting}') == f'$C error {text}'
    assert shown(m) == [320, 320, 320] and m.frame['flags'] & 8


def test_a_change_keeps_the_place_in_mm_and_loses_homing():
    m = Machine()
    m.run('G1 X123.4567 Y50 Z150 F3000')
    before = m.place()
    assert m.ask('$C steps_per_mm_x 320') == '$C ok'
    m.tick(2)
    assert m.frame['flags'] & 8, 'the same again changes nothing'
    assert m.ask('$C steps_per_mm_x 300.5') == '$C ok'
    m.tick(20)
    assert not m.frame['flags'] & 8
    assert m.frame['x_um'] == pytest.approx(123_457, abs=2) and m.frame['y_um'] == 50_000
    assert (m.place() == before).all(), 'not a pulse'
    with pytest.raises(AssertionError, match='E304'):
        m.send('G1 X10')


def test_not_while_it_moves_nor_while_a_job_is_armed():
    m = Machine()
    assert m.ask('$A j') == '$A ok'
    assert m.ask('$C steps_per_mm_y 310') == '$C error E108 steps per mm only while no job is armed'
    assert m.ask('$C steps_per_mm_y 320') == '$C ok'
    assert m.ask('$D') == '$D ok'
    m.send('G1 X20 F3000')
    m.tick(100)
    assert m.ask('$C steps_per_mm_y 310') == '$C error E108 settings only in IDLE or ALARM'
    assert m.ask('$P') == '$P ok'
    m.tick(300)
    assert m.ask('$C steps_per_mm_y 310') == '$C error E108 settings only in IDLE or ALARM'
    assert shown(m) == [320, 320, 320]


@settings(max_examples=6, deadline=None)
@given(st.data())
def test_ends_are_exact_whatever_the_steps(data):
    """Pulses are counted from homing, on a machine whose steps are other ones; nothing adds up."""
    values = [
        data.draw(st.integers(10_000, int(most * 1e3))) / 1e3 for most in (X_MOST, X_MOST, Z_MOST)
    ]
    shaped = {'shape_x': 'mzv', 'shape_x_hz': 40.0, 'shape_y': 'zv', 'shape_y_hz': 60.0}
    m = Machine(
        true_steps=(320, 320, 320), **told(*values), **(shaped if data.draw(st.booleans()) else {})
    )
    zero = np.round(m.place() * 320)
    ends = data.draw(st.lists(st.tuples(*(st.integers(0, 3000),) * 3), min_size=3, max_size=12))
    for x, y, z in ends:
        m.send(f'G1 X{x / 1e2:.2f} Y{y / 1e2:.2f} Z{170 + z / 1e2:.2f} F9000')
    m.run('G1 X1.2345 Y2.3456 Z199.9876')
    pulses = np.round(m.place() * 320) - zero
    wanted = [
        np.floor(v * k + 0.5) for v, k in zip((1.2345, 2.3456, 199.9876), values, strict=True)
    ]
    wanted[2] -= np.floor(200 * values[2] + 0.5)
    assert pulses.tolist() == wanted


def test_a_machine_that_takes_other_steps_is_true_once_the_controller_has_them():
    m = Machine(true_steps=UNEQUAL)
    m.run('G1 X300 Y200 Z100 F12000')
    wrong = m.place()
    assert abs(wrong - [300, 200, 100]).max() > 10
    for name, value in told(*UNEQUAL).items():
        assert m.ask(f'$C {name} {value}') == '$C ok'
    m.ask('$X')
    m.run('G28')
    m.run('G1 X300 Y200 Z100 F12000')
    assert m.place() == pytest.approx([300, 200, 100], abs=0.004)  # a step, and the home switches
