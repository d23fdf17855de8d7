"""Current and voltage of a burning arc as a log shows them: of plate 25 (`arc_logs`), and of a simulated bead with the
same wire feed, voltage, length of time and rate of rows. A and V; means are over 1 s."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

START = 2.0  # s after the strike that do not count
SPEED = 10e-3  # m/s
LONGEST = 0.46  # m of a bead


def recorded(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) s and rows (n, 3): wire feed (m/s), current, voltage, without the start."""
    with file.open() as f:
        rows = [(float(r['rosbagTimestamp']) * 1e-9, float(r['wfs']) / 60, float(r['current']), float(r['voltage']))
                for r in csv.DictReader(f)]  # fmt: skip
    a = np.array(rows)
    burning = a[:, 2] > 5
    a = a[burning & (a[:, 0] > a[burning, 0][0] + START)]
    return a[:, 0] - a[0, 0], a[:, 1:]


def simulated(physics, times: np.ndarray, wire: float, voltage: float, seed: int) -> np.ndarray:
    """The same rows of a bead on a plate; `voltage`: mean of the log, at the arc."""
    from waam_sim import part
    from waam_sim.drive import Drive
    from waam_sim.plant import Plant

    physics = replace(physics, arc=replace(physics.arc, strike_failure=0.0))
    length = min(SPEED * (times[-1] + START + 0.5), LONGEST)
    plant = Plant(part.plate(length + 0.02, 0.03, 0.02, 1e-3, 5e-3), _coarse(physics), seed)
    drive = Drive(plant, (0.0, 0.0, 0.05))
    ends = [(0.01, 0.015, 0.02), (0.01 + length, 0.015, 0.02)]
    readings = drive.bead(ends, length / (times[-1] + START + 0.5), wire, voltage + 0.4)
    rows = np.array([(r.wire_speed, r.current, r.voltage) for r in readings[round(100 * START) :]])
    return rows[np.minimum(np.round(times * 100).astype(int), len(rows) - 1)]


def _coarse(physics):
    """Cells of 1 mm: the arc is judged here, not the metal."""
    return replace(physics, metal=replace(physics.metal, cell=1e-3))


def figures(times: np.ndarray, rows: np.ndarray) -> dict[str, float]:
    """Sigma of current and voltage, of their means over 1 s, and their correlation."""
    second = times.astype(int)
    whole = [k for k in range(second[-1]) if (second == k).sum() >= 10]
    means = np.array([rows[second == k, 1:].mean(axis=0) for k in whole])
    return {
        'current': float(rows[:, 1].std()),
        'current_1s': float(means[:, 0].std()),
        'voltage': float(rows[:, 2].std()),
        'voltage_1s': float(means[:, 1].std()),
        'arc_correlation': float(np.corrcoef(rows[:, 1], rows[:, 2])[0, 1]),
    }
