import math

import numpy as np
import pytest

from waam_adapt.thermal.interpass import InterpassMonitor, Settings
from waam_process import materials

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
