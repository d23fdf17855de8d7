"""Envelope, greatest speeds, acceleration of Z and homing: told by `$C`, shown by `$C` alone, within what can be
stepped. What moves under them: gantry_properties.c."""

from __future__ import annotations

import pytest
from shaper_machine import Machine

FACTORY = (
    '$C envelope_x=400 envelope_y=300 envelope_z=200 max_speed_x=200 max_speed_y=200 max_speed_z=100 rapid_speed=50 '
    'max_accel_z=300 accel_limit_x=500 accel_limit_y=500 home_seek_speed=40 home_latch_speed=2 '
    'home_direction_x=-1 home_direction_y=-1 steps_per_mm_x=320 steps_per_mm_y=320 steps_per_mm_z=320'
)
LARGE = {
    'steps_per_mm_x': 150, 'steps_per_mm_y': 150, 'envelope_x': 3000, 'envelope_y': 3000, 'envelope_z': 2000,
    'max_speed_x': 500, 'max_speed_y': 500, 'rapid_speed': 500, 'max_accel_z': 100.5, 'home_direction_y': 1,
}  # fmt: skip


def test_the_settings_show_and_survive_a_reset():
    m = Machine(home=False)
    assert m.ask('$C') == FACTORY
    m = Machine(home=False, **LARGE)
    shown = (
        '$C envelope_x=3000 envelope_y=3000 envelope_z=2000 max_speed_x=500 max_speed_y=500 max_speed_z=100 '
        'rapid_speed=500 max_accel_z=100.5 accel_limit_x=500 accel_limit_y=500 home_seek_speed=40 home_latch_speed=2 '
        'home_direction_x=-1 home_direction_y=1 '
        'steps_per_mm_x=150 steps_per_mm_y=150 steps_per_mm_z=320'
    )
    assert m.ask('$C') == shown
    assert m.ask('$X') == '$X ok' and m.ask('$C') == shown
    assert ' lim=0,0,0,3000,3000,2000 ' in m.ask('$I keep')
    assert m.ask('$C@7') == shown.replace('$C', '$C@7')
    assert m.ask('$C envelope_x 2000') == '$C ok' and '_x=2000 ' in m.ask('$C@7'), 'told anew'


@pytest.mark.parametrize(
    ('setting', 'text'),
    [
        ('envelope_x 49.999', 'E104 envelope_x must lie within 50 .. 3500'),
        ('envelope_z 3500.001', 'E104 envelope_z must lie within 50 .. 3500'),
        ('envelope_y -300', 'E104 envelope_y must lie within 50 .. 3500'),
        ('max_speed_x 500.001', 'E104 max_speed_x must lie within 10 .. 500'),
        ('max_speed_z 9', 'E104 max_speed_z must lie within 10 .. 500'),
        ('rapid_speed 0', 'E104 rapid_speed must lie within 10 .. 500'),
        ('max_accel_z 49', 'E104 max_accel_z must lie within 50 .. 5000'),
        ('accel_limit_x 5001', 'E104 accel_limit_x must lie within 50 .. 5000'),
        ('home_seek_speed 101', 'E104 home_seek_speed must lie within 5 .. 100'),
        ('home_latch_speed 0.4', 'E104 home_latch_speed must lie within 0.5 .. 5'),
        ('home_direction_x 0', 'E104 home_direction_x must be -1 or 1'),
        ('home_direction_y 2', 'E104 home_direction_y must be -1 or 1'),
        ('home_direction_z -1', 'E103 no setting has this name'),
        ('envelope_x', 'E107 a number is missing or malformed'),
        ('max_speed_x 240.7', 'E105 max_speed_x: at 320 steps per mm there are pulses for at most 240.625 mm/s'),
        ('max_speed_z 241', 'E105 max_speed_z: at 320 steps per mm there are pulses for at most 240.625 mm/s'),
    ],
)  # fmt: skip
def test_what_is_absurd_is_refused_by_name_and_changes_nothing(setting, text):
    m = Machine()
    assert m.ask(f'$C {setting}') == f'$C error {text}'
    assert m.ask('$C') == FACTORY and m.frame['flags'] & 8


def test_more_steps_than_the_new_speed_has_pulses_for_are_refused():
    m = Machine(home=False, max_speed_z=200)
    said = m.ask('$C steps_per_mm_z 386')
    assert said == '$C error E105 steps_per_mm_z: at 200 mm/s there are pulses for at most 385'


@pytest.mark.parametrize(
    ('setting', 'homed'),
    [
        ('envelope_y 299', 0),
        ('home_direction_x 1', 0),
        ('max_speed_x 20', 8),
        ('rapid_speed 40', 8),
        ('max_accel_z 200', 8),
        ('accel_limit_x 2000', 8),
        ('home_seek_speed 20', 8),
    ],
)
def test_another_envelope_or_way_of_homing_loses_homing(setting, homed):
    m = Machine()
    before = m.place()
    assert m.ask(f'$C {setting}') == '$C ok'
    m.tick(20)
    assert m.frame['flags'] & 8 == homed and (m.place() == before).all(), 'not a pulse'


def test_not_while_it_moves_nor_while_a_job_is_armed():
    m = Machine()
    assert m.ask('$A j') == '$A ok'
    refused = "$C error E108 the gantry's settings only while no job is armed"
    assert m.ask('$C envelope_x 500') == refused
    assert m.ask('$C max_speed_x 100') == refused
    assert m.ask('$C envelope_x 400') == '$C ok', 'what is there may be sent again'
    assert m.ask('$D') == '$D ok'
    m.send('G1 X20 F3000')
    assert m.ask('$C envelope_x 500') == '$C error E108 settings only in IDLE or ALARM'
    assert m.ask('$C') == FACTORY, 'told in any state'


def test_the_longest_answer_fits_into_a_line():
    m = Machine(
        home=False, **{f'steps_per_mm_{a}': 123.457 for a in 'xyz'}, **{f'envelope_{a}': 3456.789 for a in 'xyz'},
        **{f'max_speed_{a}': 456.789 for a in 'xyz'}, rapid_speed=456.789, max_accel_z=4567.891, accel_limit_x=4567.891,
        accel_limit_y=4567.891, home_seek_speed=67.891, home_latch_speed=3.457,
    )  # fmt: skip
    answer = m.ask('$C@4294967295')
    assert 'envelope_z=3456.79 ' in answer and 'home_latch_speed=3.457' in answer
    more = 6  # digits of envelopes and accelerations that this machine's words leave out
    assert len(answer) + len('*0123456789\n') + more <= 480


def test_a_higher_limit_lets_the_calibration_choose_more_and_a_lower_one_counts_at_once():
    m = Machine()
    assert 'E105 max_accel_x: the machine has at most 500' in m.ask('$C max_accel_x 900')
    assert m.ask('$C accel_limit_x 2000') == '$C ok' and ' max_accel_x=500 ' in m.ask('$L')
    assert m.ask('$C max_accel_x 900') == '$C ok' and ' max_accel_x=900 ' in m.ask('$L@3')
    assert m.ask('$C accel_limit_x 300') == '$C ok' and ' max_accel_x=300 ' in m.ask('$L@4')


@pytest.mark.parametrize('seek', [5, 20, 100])
def test_homing_seeks_with_the_speed_that_is_set_and_never_brakes_longer_than_to_the_limit(seek):
    m = Machine(home=False, home_seek_speed=seek)
    m.run('G28')
    fastest = max(f['v_um_s'] for f in m.frames) * 1e-3
    assert fastest == pytest.approx(min(seek, (2 * 500 * 3.0) ** 0.5), rel=0.02)
    assert m.frame['flags'] & 8


def test_rapids_run_at_the_speed_that_is_set():
    m = Machine(rapid_speed=180)
    m.run('G0 X300')
    assert max(f['v_um_s'] for f in m.frames[-2500:]) == pytest.approx(180_000, rel=0.01)
