import math

import numpy as np
import pytest

from waam_adapt.thermal.interpass import InterpassMonitor, Settings
from waam_adapt.thermal.response import LaidLayer
from waam_process import materials
from waam_process.heat import ArcPass

STEEL = materials.get('er70s-6')


def monitor(**changes):
    return InterpassMonitor(STEEL, Settings(STEEL.interpass_limit, **changes))


def feed(m, temperatures, start=0.0, step=0.1):
    """Samples at 10 Hz; returns the time of the last."""
    for i, t in enumerate(temperatures):
        m.add(start + i * step, t)
    return start + (len(temperatures) - 1) * step


def noisy(values, seed=0):
    return np.asarray(values, float) + np.random.default_rng(seed).normal(0, 0.5, len(values))


def test_before_any_sample_nothing_is_believed():
    heat = monitor().state(100.0)
    assert (heat.plausible, heat.ready, heat.factor) == (False, False, 1.0)
    assert math.isnan(heat.temperature)


def test_warm_layer_waits_as_long_as_it_takes_to_cool():
    tau, time = 120.0, np.arange(0, 30, 0.1)
    m = monitor()
    now = feed(m, noisy(20 + 380 * np.exp(-time / tau)))
    heat = m.state(now)
    assert heat.plausible
    assert not heat.ready
    truth = 20 + 380 * math.exp(-now / tau)
    assert heat.temperature == pytest.approx(truth, abs=1.0)
    assert heat.factor == pytest.approx(1 - 7.5e-4 * (truth - 200), abs=1e-3)
    assert heat.wait == pytest.approx(tau * math.log((truth - 20) / 230), rel=0.3)


def test_ready_below_the_limit():
    m = monitor()
    heat = m.state(feed(m, noisy(np.full(40, 180.0))))
    assert (heat.ready, heat.wait, heat.factor) == (True, 0.0, 1.0)


def test_a_layer_that_still_heats_up_has_no_estimate():
    m = monitor()
    heat = m.state(feed(m, np.linspace(260, 320, 60)))
    assert not heat.ready
    assert math.isnan(heat.wait)
    assert heat.rate > 0


def test_ramp_of_the_source_gives_a_factor_without_oscillation():
    """20 to 400 degC within 10 minutes, noisy pyrometer."""
    m, factors = monitor(), []
    for i, t in enumerate(noisy(np.linspace(20, 400, 6000))):
        m.add(i * 0.1, t)
        if i > 10:
            factors.append(m.state(i * 0.1).factor)
    assert factors[0] == 1.0
    assert factors[-1] == pytest.approx(0.85, abs=2e-3)
    assert max(np.diff(factors)) < 1e-3


def test_silence_is_noticed_and_ends():
    m = monitor()
    now = feed(m, noisy(np.full(30, 180.0)))
    assert m.state(now + 1.9).plausible
    silent = m.state(now + 2.1)
    assert (silent.plausible, silent.ready, silent.factor) == (False, False, 1.0)
    assert 'silent for 2.1 s' in silent.reasons[0]
    assert m.state(feed(m, noisy(np.full(30, 170.0)), start=now + 10)).plausible


def test_stuck_pyrometer():
    m = monitor()
    now = feed(m, noisy(np.full(30, 180.0)))
    now = feed(m, np.full(99, 180.0), start=now + 0.1)
    assert m.state(now).ready
    now = feed(m, np.full(10, 180.0), start=now + 0.1)
    heat = m.state(now)
    assert not heat.plausible
    assert 'stuck at 180.0' in heat.reasons[0]
    assert m.state(feed(m, noisy(np.full(5, 181.0)), start=now + 0.1)).plausible


@pytest.mark.parametrize(
    ('value', 'word'), [(math.nan, 'no number'), (-90.0, 'outside'), (3000.0, 'outside')]
)
def test_reading_that_cannot_be(value, word):
    m = monitor()
    now = feed(m, noisy(np.full(30, 180.0)))
    m.add(now + 0.1, value)
    heat = m.state(now + 0.1)
    assert not heat.plausible
    assert word in heat.reasons[0]
    assert heat.temperature == pytest.approx(180, abs=1)
    m.add(now + 0.2, 180.3)
    assert m.state(now + 0.2).plausible


def test_a_spike_is_left_out_and_a_new_level_is_taken():
    m = monitor()
    now = feed(m, noisy(np.full(30, 180.0)))
    m.add(now + 0.1, 600.0)
    heat = m.state(now + 0.1)
    assert not heat.plausible
    assert 'jumped to 600' in heat.reasons[0]
    m.add(now + 0.2, 180.5)
    back = m.state(now + 0.2)
    assert back.plausible
    assert back.temperature == pytest.approx(180, abs=1)
    now = feed(m, noisy(np.full(10, 600.0)), start=now + 0.3)
    high = m.state(now)
    assert high.plausible
    assert high.temperature == pytest.approx(600, abs=2)


def test_samples_out_of_order_are_ignored_and_a_clock_set_back_starts_afresh():
    m = monitor()
    now = feed(m, noisy(np.full(30, 180.0)), start=50.0)
    m.add(now - 0.5, 300.0)
    assert m.state(now).temperature == pytest.approx(180, abs=1)
    now = feed(m, noisy(np.full(30, 90.0)), start=0.0)
    heat = m.state(now)
    assert heat.plausible
    assert heat.temperature == pytest.approx(90, abs=1)


def lay(m, number, temperatures, start, duration=60.0, power=2430.0, after=20.0):
    """A layer of `duration` s under readings at 10 Hz that go through `temperatures`; returns the time at the end."""
    now = feed(m, noisy(np.full(30, temperatures[0]), number), start=start)
    m.response.layer_begins()
    n = round(duration * 10)
    during = np.interp(np.linspace(0, 1, n), np.linspace(0, 1, len(temperatures)), temperatures)
    now = feed(m, noisy(during, number), start=now + 0.1)
    m.response.layer_ends(LaidLayer(number, now, ArcPass(power, 10e-3, duration)))
    return feed(m, noisy(np.full(round(after * 10), temperatures[-1]), number), start=now + 0.1)


def test_a_temperature_that_does_not_answer_to_a_layer_is_not_believed():
    """The pyrometer looks past a small cylinder: 21 degC and ready from first to last layer."""
    m = monitor()
    assert m.state(feed(m, noisy(np.full(30, 21.0)))).believed
    heat = m.state(lay(m, 1, [21.0, 21.4], start=10.0))
    assert heat.plausible and heat.ready
    assert not heat.believed
    assert 'layer 1 brought 146 kJ' in heat.doubt
    assert 'spot of the pyrometer does not lie on the layer' in heat.doubt


@pytest.mark.parametrize(
    'seen',
    [
        [21.0, 60.0, 500.0, 120.0],  # the torch passed over the spot
        [21.0, 50.0, 95.0],  # a layer on a thick plate, the spot beside it
        [240.0, 235.0, 420.0, 260.0],  # a warm part that cools until the torch comes
    ],
)
def test_a_temperature_that_answers_is_believed(seen):
    m = monitor()
    assert m.state(lay(m, 1, seen, start=10.0)).believed


def test_belief_returns_when_a_later_layer_is_seen_and_with_a_new_job():
    m = monitor()
    now = lay(m, 1, [21.0, 21.0], start=10.0)
    assert not m.state(now).believed
    now = lay(m, 2, [21.0, 400.0, 150.0], start=now + 0.1)
    assert m.state(now).believed
    now = lay(m, 3, [150.0, 140.0], start=now + 0.1)
    assert not m.state(now).believed
    m.response.forget()
    assert m.state(now).believed


def test_a_touch_of_the_arc_is_too_little_heat_to_tell():
    m = monitor()
    assert m.state(lay(m, 1, [21.0, 21.0], start=10.0, duration=1.0, power=100.0)).believed


def test_heat_gets_time_to_arrive_before_it_is_missed():
    """The last bead lies 12 mm beside the spot: nothing is said while its heat is on the way."""
    m = monitor()
    now = lay(m, 1, [21.0, 21.0], start=10.0, after=1.0)
    assert m.state(now).believed
    now = feed(m, noisy(np.linspace(21.0, 110.0, 40)), start=now + 0.1)
    assert m.state(now).believed


def test_another_material_brings_its_own_limit_and_law():
    m = monitor()
    now = feed(m, noisy(np.full(30, 180.0)))
    assert m.state(now).ready
    steel = materials.get('316l')
    m.use(steel, steel.interpass_limit)
    assert not m.state(now).ready
    m.material_error = "unknown material 'unobtainium'"
    assert m.state(now).reasons == ("unknown material 'unobtainium'",)
