"""The temperature of the part: a converter's voltage becomes degrees Celsius in lines of the link, or is unknown."""

from __future__ import annotations

import math

import pytest
from shaper_machine import Machine

VOLTAGE, LOOP, AMPLIFIER = 1, 2, 3  # $C temperature_input
KNOWN, BELOW, ABOVE, NO_READING = range(4)
AT_CONVERTER = {VOLTAGE: 3.0 / 10.0, LOOP: 0.15, AMPLIFIER: 1.0}  # V per V, mA, V of the signal


def readings(machine: Machine, ms: int) -> list[tuple[int, int, float]]:
    """Time us, fault, degC of the lines of the next ms; NaN where the line has no number."""
    before = len(machine.lines)
    machine.tick(ms)
    found = [line[2:].split(',') for line in machine.lines[before:] if line.startswith('P ')]
    return [(int(t), int(why), int(mc) / 1000 if mc else math.nan) for t, why, mc in found]


@pytest.fixture
def machine() -> Machine:
    m = Machine(home=False)
    m.core.part(0.0)
    return m


def measure(machine: Machine, kind: int, low: float = 0.0, high: float = 1000.0) -> None:
    for name, value in (('input', 0), ('low_c', low), ('high_c', high), ('input', kind)):
        assert machine.ask(f'$C temperature_{name} {value:g}') == '$C ok'


@pytest.mark.parametrize(
    ('kind', 'low', 'high', 'signal', 'celsius'),
    [
        (VOLTAGE, 0, 1000, 0.2, 20.0), (VOLTAGE, 0, 1000, 4.0, 400.0), (VOLTAGE, 200, 1200, 10.0, 1200.0),
        (LOOP, 0, 500, 4.0, 0.0), (LOOP, 0, 500, 16.8, 400.0), (LOOP, -50, 450, 20.0, 450.0),
        (LOOP, 0, 500, 3.8, -6.25), (AMPLIFIER, 0, 600, 0.1, 20.0), (AMPLIFIER, 0, 600, 2.0, 400.0),
    ],
)  # fmt: skip
def test_every_kind_of_signal_is_scaled_between_its_ends(machine, kind, low, high, signal, celsius):
    machine.core.part(signal * AT_CONVERTER[kind])
    measure(machine, kind, low, high)
    (_, why, found), *_ = readings(machine, 250)
    assert why == KNOWN and found == pytest.approx(celsius, abs=2e-3)


@pytest.mark.parametrize(
    ('kind', 'signal', 'why'),
    [
        (VOLTAGE, 0.0, BELOW), (VOLTAGE, 0.04, BELOW), (VOLTAGE, 10.6, ABOVE), (LOOP, 0.0, BELOW),
        (LOOP, 3.5, BELOW), (LOOP, 21.1, ABOVE), (AMPLIFIER, 0.0, BELOW), (AMPLIFIER, 3.3, ABOVE),
        (VOLTAGE, math.nan, NO_READING), (LOOP, math.nan, NO_READING), (AMPLIFIER, math.nan, NO_READING),
    ],
)  # fmt: skip
def test_a_signal_that_no_instrument_gives_is_unknown_and_no_number(machine, kind, signal, why):
    machine.core.part(signal * AT_CONVERTER[kind])
    measure(machine, kind)
    found = readings(machine, 350)
    assert len(found) >= 3 and {f[1] for f in found} == {why}
    assert all(math.isnan(f[2]) for f in found)


def test_lines_come_ten_times_a_second_and_are_means(machine):
    measure(machine, VOLTAGE)
    machine.core.part(0.3 * 1.0)
    readings(machine, 200)
    swing = []
    for _ in range(100):  # 2 ms each way around 300 degC
        for volts in (0.8, 1.0):
            machine.core.part(volts)
            swing += readings(machine, 5)
    times = [t for t, _, _ in swing]
    assert len(swing) in (9, 10, 11)
    assert all(b - a == 100_000 for a, b in zip(times, times[1:], strict=False))
    assert all(found == pytest.approx(300.0, abs=0.5) for _, _, found in swing[1:])


def test_one_spike_spoils_no_reading_and_a_torn_wire_shows_at_once(machine):
    machine.core.part(0.9)
    measure(machine, VOLTAGE)
    readings(machine, 120)
    machine.core.part(3.3)
    readings(machine, 10)
    machine.core.part(0.9)
    assert all(
        why == KNOWN and c == pytest.approx(300.0, abs=0.01) for _, why, c in readings(machine, 200)
    )
    machine.core.part(0.0)
    assert readings(machine, 200)[-1][1] == BELOW


def test_nothing_is_sent_until_it_is_switched_on_and_after_it_is_off(machine):
    machine.core.part(0.9)
    assert readings(machine, 300) == []
    measure(machine, VOLTAGE)
    assert readings(machine, 300)
    assert machine.ask('$C temperature_input 0') == '$C ok'
    assert readings(machine, 300) == []


def test_settings_are_shown_survive_a_reset_and_are_refused_by_name(machine):
    measure(machine, LOOP, -50, 450.5)
    shown = ' temperature_input=2 temperature_low_c=-50 temperature_high_c=450.5'
    assert machine.ask('$L').endswith(shown)
    assert machine.ask('$X') == '$X ok' and machine.ask('$L').endswith(shown)
    assert 'TEMPERATURE' in machine.ask('$I')
    for setting, text in (
        ('temperature_input 4', 'E104 temperature_input must be a whole number within 0 .. 3'),
        ('temperature_low_c -300', 'E104 temperature_low_c must lie within -273 .. 3000'),
        (
            'temperature_low_c 450.5',
            'E105 temperature_low_c: the upper end must be above the lower one',
        ),
    ):
        assert machine.ask(f'$C {setting}') == f'$C error {text}'
    assert machine.ask('$L').endswith(shown)


def test_a_controller_without_the_input_says_so():
    machine = Machine(home=False)
    assert 'TEMPERATURE' not in machine.ask('$I') and 'temperature' not in machine.ask('$L')
    answer = machine.ask('$C temperature_input 1')
    assert answer == '$C error E108 this controller has no input for it'
    assert readings(machine, 200) == []


def test_torch_and_drives_stay_what_trips_over_temperature(machine):
    """A part of 400 degC on the pyrometer is no over-temperature of the machine."""
    machine.core.part(1.2)
    measure(machine, VOLTAGE)
    assert readings(machine, 150)[-1][2] == pytest.approx(400.0, abs=0.01)
    machine.run('G28')
    assert machine.ask('$A job') == '$A ok'
    machine.send('M3 W3000 S22', 'G1 X5 F600', 'M5')
    machine.until(lambda f: f['flags'] & 2, 3000)
    assert machine.frame['fault'] == 0
