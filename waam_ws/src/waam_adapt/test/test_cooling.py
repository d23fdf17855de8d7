import math
from pathlib import Path

import numpy as np
import pytest

from waam_adapt.thermal.cooling import CoolingModel, Curve
from waam_adapt.thermal.interpass import InterpassMonitor, Settings
from waam_process import materials

STEEL = materials.get('er70s-6')


def dwell(peak, time):
    """Two time constants, as a pass over a warm wall leaves them: no single exponential."""
    return 20 + (peak - 20) * (0.55 * np.exp(-time / 12.0) + 0.45 * np.exp(-time / 150.0))


def layers(model, peaks, seconds=80.0, clock=0.0):
    """Dwells one after another at 2 Hz, each begun by a quick rise."""
    for peak in peaks:
        for time in np.arange(0, seconds, 0.5):
            model.add(clock, float(dwell(peak, time)))
            clock += 0.5
    return clock


def reach(peak, limit):
    time = np.arange(0, 200, 0.01)
    return float(time[np.argmax(dwell(peak, time) <= limit)])


def test_wait_is_learned_from_the_layers_before():
    m = CoolingModel(20.0)
    assert math.isnan(m.wait(300.0))
    clock = layers(m, (800.0, 830.0, 860.0))
    layers(m, (890.0,), seconds=20.0, clock=clock)
    true = reach(890.0, 350.0) - 19.5
    assert m.wait(350.0) == pytest.approx(true, rel=0.05)
    assert m.wait(900.0) == 0.0


def test_a_layer_unlike_the_last_is_not_predicted():
    m = CoolingModel(20.0)
    clock = layers(m, (800.0, 810.0))
    m.add(clock, 1500.0)
    for time in np.arange(0.5, 20, 0.5):
        m.add(clock + time, float(dwell(1500.0, time)))
    assert math.isnan(m.wait(350.0))


def test_curve_goes_on_beyond_its_end_and_never_below_the_room():
    time = np.arange(0, 60, 0.5)
    curve = Curve(time, 20 + 300 * np.exp(-time / 80))
    assert curve.reaches(100.0, 20.0) == pytest.approx(80 * math.log(300 / 80), rel=0.02)
    assert math.isnan(curve.reaches(10.0, 20.0))


def test_monitor_uses_what_it_learned_instead_of_one_exponential():
    m = InterpassMonitor(STEEL, Settings(350.0, jump=2000.0))
    clock = layers(m, (800.0, 820.0, 840.0))
    clock = layers(m, (860.0,), seconds=15.0, clock=clock)
    heat = m.state(clock - 0.5)
    assert heat.plausible
    assert heat.wait == pytest.approx(reach(860.0, 350.0) - 14.5, rel=0.08)


@pytest.mark.parametrize('fall', [0.0, 60.0])
def test_emissivity_jump_is_not_believed_until_it_is_old(fall):
    """Also one that is so large that five samples have to agree on it first."""
    m = InterpassMonitor(STEEL, Settings(250.0, hold=10.0))
    for i in range(50):
        m.add(i * 0.1, 400.0 - 0.2 * i + 0.05 * (i % 3))
    assert m.state(4.9).plausible
    for i in range(50, 160):
        m.add(i * 0.1, 240.0 - 0.1 * i + 0.05 * (i % 3) + fall)
        if i == 56:
            now = m.state(5.6)
            assert (now.plausible, now.ready, now.factor) == (False, False, 1.0)
            assert 'emissivity' in now.reasons[0]
    assert m.state(15.9).plausible


def test_a_pass_of_the_torch_is_no_emissivity_jump():
    m = InterpassMonitor(STEEL, Settings(250.0))
    for i in range(40):
        m.add(i * 0.1, 240.0 + (0.0 if i < 20 else 90.0) + 0.05 * (i % 3))
    assert m.state(3.9).plausible


FOLDER = Path(__file__).parents[5] / 'shared' / 'data' / 'interlayer_temperature'


@pytest.mark.skipif(not FOLDER.exists(), reason='recordings are not beside the checkout')
def test_recorded_dwells_are_predicted():
    """Half way into a dwell of a recorded wall, the temperature at its end: nine of ten waits within 15 %."""
    t, y = np.genfromtxt(FOLDER / 'plate40_L2-60_pos55.csv', delimiter=',', skip_header=1).T
    t, y = t[np.isfinite(y)], y[np.isfinite(y)]
    tops = [i for i in range(20, len(y) - 20) if y[i] == y[i - 20 : i + 21].max() > 590][2:]
    errors = []
    m, asked = CoolingModel(20.0), {i + 25: i for i in tops}
    for i in range(len(t)):
        m.add(t[i], y[i])
        if i in asked:
            limit = y[i + 20]
            errors.append(abs(m.wait(limit) / 20.0 - 1))
    assert len(errors) >= 10
    assert np.mean(np.array(errors) <= 0.15) >= 0.9
