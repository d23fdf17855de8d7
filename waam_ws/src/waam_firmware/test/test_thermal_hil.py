"""Thermal hardware-in-the-loop of the source: the pyrometer ramps from 20 to 400 degrees, the Kt law of
the real compensator (waam_adapt) becomes a wire override over the pty, and the controller's wire command is what is
judged: unchanged to 200 degrees, then linear, 85 % at 400, no oscillation."""

from __future__ import annotations

import numpy as np
import pytest

thermal = pytest.importorskip('waam_adapt.thermal.interpass', reason='waam_adapt is not built')
materials = pytest.importorskip('waam_process.materials')

FULL = 5000 / 60 * 1000  # um/s of the program's W5000
RAMP_US = 40_000_000  # of controller time
PERIOD_US = 100_000  # of the pyrometer
NOISE = 0.5  # K, sigma of a pyrometer reading


def temperature(t_us: int, begin_us: int) -> float:
    """degC: 2 s at 20, the ramp, then 400."""
    return 20.0 + 380.0 * float(np.clip((t_us - begin_us - 2_000_000) / RAMP_US, 0.0, 1.0))


def ramp(client) -> tuple[np.ndarray, np.ndarray]:
    """Answers (n, 2): temperature in degC and the share asked for because of it, a row for each change of the override.
    Wire (m, 2): override in force and wire command, shares of the program's, one row for each frame."""
    material = materials.get(materials.DEFAULT)
    monitor = thermal.InterpassMonitor(material, thermal.Settings(interpass_limit=500.0))
    rng, answers, wire = np.random.default_rng(2), [(20.0, 1.0)], []
    begin = client.frame['t_us']
    seen, due = len(client.frames), begin
    while client.frame['t_us'] < begin + RAMP_US + 5_000_000:
        client.wait(lambda seen=seen: len(client.frames) > seen)
        for frame in client.frames[seen:]:
            seen += 1
            t_us = frame['t_us']
            wire.append((frame['wire_permille'] / 1000, frame['wire_cmd_um_s'] / FULL))
            if t_us < due:
                continue
            due += PERIOD_US
            heat = temperature(t_us, begin)
            monitor.add(t_us * 1e-6, heat + NOISE * rng.standard_normal())
            share = round(1000 * monitor.state(t_us * 1e-6).factor) / 1000
            if share != answers[-1][1]:
                answers.append((heat, share))
                client.text(f'$V 1000 {1000 * share:.0f}')
        assert client.frame['state'] == 1, client.lines[-3:]
    return np.array(answers), np.array(wire)


def test_wire_follows_the_thermal_law_from_20_to_400_degrees(client):
    client.ready_for_arc()
    client.send('G0 X10 Y50 Z100', 'M3 W5000 S22', 'G1 X390 F240')
    client.wait(lambda: client.frame['flags'] & 2 and client.frame['v_um_s'] > 0)
    client.wait(lambda: client.frame['wire_cmd_um_s'] == round(FULL))
    answers, wire = ramp(client)
    # the law: nothing to 200 degC (the first change is the pyrometer's noise at the kink), 85 % at 400, linear between
    heat, share = answers.T
    assert heat[1] > 198.0 and len(answers) > 100
    assert share[-1] == pytest.approx(0.85, abs=1.5e-3)
    line = 1.0 - 0.15 * np.clip(heat - 200.0, 0.0, 200.0) / 200.0
    assert np.abs(share - line).max() < 3e-3
    assert np.max(share - np.minimum.accumulate(share)) <= 2e-3  # no oscillation beyond the noise
    # the controller: what is in force came from the law, and the wire command stands on it whenever it is not changing
    force, command = wire.T
    assert set(force) <= set(share)
    assert np.all(command[force == 1.0] == pytest.approx(1.0, abs=1e-4))
    assert np.all(np.abs(command[-100:] - share[-1]) < 1e-4)
    settled = np.convolve(force[1:] != force[:-1], np.ones(20), 'full')[: len(force) - 1] == 0
    assert settled.any() and np.abs(command[1:] - force[1:])[settled].max() < 1e-4
    assert np.abs(command - force).max() < 0.05  # the lead for the feeder's lag, no more
