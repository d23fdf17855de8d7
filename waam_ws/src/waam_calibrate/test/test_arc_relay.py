"""The relay experiment: on the shipped regulator's code, on plants that are made up, and records that are none."""

from __future__ import annotations

import ctypes
import math
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_calibrate import outcome, pictures, regulator, report, store
from waam_calibrate.evidence import EvidenceError
from waam_calibrate.regulator import SHIPPED, Plant, Swing, experiment, ziegler_nichols
from waam_calibrate.relay import analyse

sys.path.insert(0, str(Path(__file__).parents[2] / 'waam_firmware' / 'test'))
import arc_loop  # noqa: E402  the regulator's C code as a library
import loop_library  # noqa: E402

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


def relay_on_the_controller(gain: float, amplitude: float = 2.0) -> Swing:
    """An integral that is far too strong within +-amplitude is a relay; the code is the shipped one."""
    library = arc_loop._library()
    gains = (ctypes.c_float * 4)(1e-3, 1e6, 0.0, 0.0)
    assert library.arc_loop_start(False, False, gains, amplitude) is None
    plant, rng, rows = arc_loop.Plant(gain), np.random.default_rng(1), []
    begin, level = 2000, arc_loop.SETPOINT
    for k in range(begin + 12000):
        volts = level + plant.change + 0.05 * rng.standard_normal()
        wanted = level + 0.3 * amplitude * gain
        out = arc_loop.step(wanted, volts) if k >= begin else level
        plant.advance(out)
        rows.append((k * arc_loop.TS, out, volts))
    return Swing(*np.array(rows).T)


@pytest.mark.skipif(not loop_library.path('arc_loop').exists(), reason='the library is not built')
@pytest.mark.parametrize('gain', [0.6, 1.0, 1.5])
def test_a_relay_on_the_shipped_code_shows_its_plant(gain) -> None:
    found = analyse(relay_on_the_controller(gain))
    assert found.plant.gain == pytest.approx(gain, rel=0.02)
    assert found.plant.lag == pytest.approx(arc_loop.LAG, rel=0.03)
    assert found.plant.delay == pytest.approx(arc_loop.DELAY, abs=3e-4)
    assert found.ku == pytest.approx(8.50 / gain, rel=0.1)  # -180 degrees at 169 rad/s
    assert found.tu == pytest.approx(0.0372, rel=0.1)


def ultimate(plant: Plant) -> tuple[float, float]:
    w = 0.5 * math.pi / plant.delay
    for _ in range(60):
        w = (math.pi - math.atan(w * plant.lag)) / plant.delay
    return math.hypot(1, w * plant.lag) / plant.gain, 2 * math.pi / w


@given(st.floats(0.5, 2.0), st.floats(0.02, 0.1), st.floats(0.15, 0.5))
@settings(max_examples=10, deadline=None)
def test_any_plant_is_found(gain, lag, share) -> None:
    plant = Plant(gain, lag, share * lag)
    found = analyse(experiment(plant, amplitude=4.0, noise=0.02))
    assert found.plant.gain == pytest.approx(gain, rel=0.03)
    assert found.plant.lag == pytest.approx(lag, rel=0.05)
    assert found.plant.delay == pytest.approx(plant.delay, rel=0.05)
    ku, tu = ultimate(plant)
    # the hysteresis against noise slows the swing
    assert found.ku == pytest.approx(ku, rel=0.35) and found.tu == pytest.approx(tu, rel=0.35)


def test_rules_and_what_they_do() -> None:
    gains = ziegler_nichols(8.0, 0.04)
    assert (gains.kp, gains.ki, gains.kd) == pytest.approx((4.8, 240.0, 0.024))
    plant = Plant(1.0, 0.05, 0.01)
    calm = regulator.analytic(plant)
    assert (calm.kp, calm.ki) == pytest.approx((2.5, 50.0))
    response = regulator.step_response(calm, plant)
    assert 0.02 < regulator.overshoot(response) < 0.08 and regulator.settling(response) < 0.09
    assert regulator.margin(calm, plant) == pytest.approx(61.4, abs=1.0)
    assert regulator.margin(SHIPPED, plant) > 60  # doc/arc_regulator.md: 62.8 deg at a gain of 1.5
    assert regulator.margin(SHIPPED, replace(plant, gain=1.5)) == pytest.approx(62.8, abs=1.5)
    assert regulator.overshoot(regulator.step_response(gains, plant)) > 0.3


def test_result_and_its_page() -> None:
    good = analyse(experiment(Plant(1.0, 0.05, 0.01)))
    result = outcome.of_arc(good, NOW)
    assert not result.refuses and not result.settings
    lines = report.gain_lines(outcome.gains_of(good), good.plant)
    assert [line.split()[0] for line in lines] == ['shipped', 'ziegler', 'analytic']
    page = report.page(result, [pictures.relay_swing(good)], lines)
    assert 'ziegler_nichols_kp' in page
    wild = outcome.of_arc(analyse(experiment(Plant(3.0, 0.05, 0.02))), NOW)
    assert 'phase margin' in wild.refuses


def test_records_that_are_no_experiment_are_refused() -> None:
    swing = experiment(Plant(1.0, 0.05, 0.01))
    n = len(swing.time)
    ramp = np.linspace(20, 24, n)
    for text, bad in (
        ('100 at least', Swing(*(c[:50] for c in (swing.time, swing.output, swing.voltage)))),
        ('not a finite', replace(swing, voltage=np.full(n, np.nan))),
        ('never changes', replace(swing, output=np.full(n, 22.0))),
        (
            'before the relay begins',
            Swing(*(c[3100:] for c in (swing.time, swing.output, swing.voltage))),
        ),
        ('more than two levels', replace(swing, output=ramp)),
        ('whole periods', Swing(*(c[:4000] for c in (swing.time, swing.output, swing.voltage)))),
        ('evenly spaced', replace(swing, time=swing.time**2)),
        ('record faster', Swing(*(c[::40] for c in (swing.time, swing.output, swing.voltage)))),
        ('larger relay', replace(swing, voltage=22 + np.random.default_rng(1).normal(0, 2, n))),
        ('of the swing', replace(swing, voltage=swing.voltage[::-1].copy())),
    ):
        with pytest.raises(EvidenceError, match=text):
            analyse(bad)


@given(st.binary(max_size=200))
@settings(max_examples=80, deadline=None)
def test_any_bytes_as_a_file(tmp_path_factory, data) -> None:
    path = tmp_path_factory.mktemp('relay') / 'a.csv'
    path.write_bytes(data)
    try:
        store.load_swing(path)
    except EvidenceError as e:
        assert str(path) in str(e)


def test_a_file_with_names(tmp_path) -> None:
    path = tmp_path / 'relay.csv'
    path.write_text('time,output,voltage\n0,22,21.9\n1e-3,24,22.1\n')
    assert store.load_swing(path).output.tolist() == [22.0, 24.0]
