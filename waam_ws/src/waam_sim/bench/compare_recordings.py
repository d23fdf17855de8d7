"""Prints the simulated arc and cooling beside recordings of real cells (../shared/data beside the checkout).

python3 waam_ws/src/waam_sim/bench/compare_recordings.py [FOLDER]
"""

from __future__ import annotations

import csv
import dataclasses
import sys
from pathlib import Path

import numpy as np

from waam_sim import part
from waam_sim.arc import ArcParams
from waam_sim.drive import Drive
from waam_sim.plant import Plant, PlantParams

FOLDER = Path(__file__).resolve().parents[5] / 'shared' / 'data'


def recorded_wall(path: Path) -> np.ndarray:
    """Rows (wire m/min, A, V) of the six layers of arc_log.csv, without 1.5 s of each start and 0.3 s of each end."""
    rows = [
        line.split(',') for line in path.read_text().replace('\r', '\n').split('\n')[1:] if line
    ]
    seconds = np.array([60 * int(r[0].split(':')[0]) + float(r[0].split(':')[1]) for r in rows])
    on = np.array([float(r[5]) > 0 for r in rows])
    values = np.array([[float(r[6]), float(r[7]), float(r[8])] for r in rows])
    edges = np.flatnonzero(np.diff(on.astype(int)))
    parts = [
        values[a + 1 : b + 1][
            (seconds[a + 1 : b + 1] > seconds[a] + 1.5)
            & (seconds[a + 1 : b + 1] < seconds[b] - 0.3)
        ]
        for a, b in zip(edges[::2], edges[1::2], strict=False)
    ]
    return np.concatenate(parts)


def recorded_plate(path: Path) -> np.ndarray:
    """Rows (wire m/min, A, V) of plate25_weld_params.csv from 2 s after the arc start."""
    with path.open() as f:
        rows = [(float(r['rosbagTimestamp']) * 1e-9, float(r['wfs']), float(r['current']), float(r['voltage']))
                for r in csv.DictReader(f)]  # fmt: skip
    a = np.array(rows)
    start = a[a[:, 2] > 5, 0][0]
    return a[(a[:, 0] > start + 2) & (a[:, 2] > 5), 1:]


def simulated(wire_m_min: float, voltage: float) -> np.ndarray:
    """Rows (wire m/min, A, V) of a bead at these settings, 100 Hz."""
    plant = Plant(part.plate(0.12, 0.06, 0.02, 4e-4, 0.015))
    drive = Drive(plant, (0.0, 0.0, 0.05))
    readings = drive.bead([(0.01, 0.03, 0.02), (0.11, 0.03, 0.02)], 0.01, wire_m_min / 60, voltage)[
        150:
    ]
    return np.array([(r.wire_speed * 60, r.current, r.voltage) for r in readings])


def describe(name: str, a: np.ndarray) -> str:
    m, s = a.mean(axis=0), a.std(axis=0)
    r = np.corrcoef(a[:, 1], a[:, 2])[0, 1]
    return f'{name:34s} {m[0]:5.2f}  {m[1]:6.1f} ±{s[1]:4.1f}  {m[2]:6.2f} ±{s[2]:4.2f}  {r:5.2f}'


def cooling(
    time: np.ndarray, celsius: np.ndarray, after: int, ambient: float = 22.0
) -> list[np.ndarray]:
    """Excess temperature 10, 20 and 30 s after each peak over that 5 s after it; only undisturbed coolings."""
    curves = []
    for i in range(after, len(celsius) - after):
        if celsius[i] < celsius[i - 15 : i + 16].max() or celsius[i] < celsius[i + 25] + 60:
            continue
        at = np.interp(np.array([5.0, 10.0, 20.0, 30.0]) + time[i], time, celsius) - ambient
        if (np.diff(at) < 0).all():
            curves.append(at[1:] / at[0])
    return curves


def recorded_cooling(path: Path) -> list[np.ndarray]:
    with path.open() as f:
        a = np.array([[float(v) for v in row] for row in list(csv.reader(f))[1:]])
    a = a[np.isfinite(a[:, 1])]
    return cooling(a[:, 0], a[:, 1], 40)


def simulated_cooling() -> list[np.ndarray]:
    """The same of a simulated wall of eight layers with 45 s between them, read in the middle, where a layer ends."""
    base = PlantParams()
    params = dataclasses.replace(base, arc=ArcParams(strike_failure=0.0))
    plant = Plant(part.plate(0.12, 0.04, 0.012, 4e-4, 0.015), params)
    drive = Drive(plant, (0.0, 0.0, 0.05))
    out, top = [], 0.012
    for layer in range(8):
        ends = [(0.02, 0.02, top), (0.1, 0.02, top)]
        for end in ends[::-1] if layer % 2 else ends:
            drive.bead([end, (0.06, 0.02, top)], 0.01)
        excess = []
        for pause in (5.0, 5.0, 10.0, 10.0):
            drive.wait(pause)
            excess.append(plant.heat.at(0.06, 0.02) - 22.0)
        out.append(np.array(excess[1:]) / excess[0])
        drive.wait(15.0)
        top = float(plant.metal.z.max())
    return out


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    wall = recorded_wall(folder / 'wall_profiles' / 'arc_log.csv')
    plate = recorded_plate(folder / 'arc_logs' / 'plate25_weld_params.csv')
    print('arc                                wire   current      voltage       r(I, U)')
    print(describe('recorded wall (arc_log.csv)', wall))
    print(
        describe(
            'simulated, same wire and voltage',
            simulated(wall[:, 0].mean(), wall[:, 2].mean() + 0.4),
        )
    )
    print(describe('recorded plate 25', plate))
    print(
        describe(
            'simulated, same wire and voltage',
            simulated(plate[:, 0].mean(), plate[:, 2].mean() + 0.4),
        )
    )
    print('\nexcess temperature after 10, 20, 30 s over that after 5 s')
    for name in ('plate36_L2-110_pos55', 'plate40_L2-60_pos55'):
        curves = np.array(recorded_cooling(folder / 'interlayer_temperature' / f'{name}.csv'))
        print(
            f'{name:34s} {np.round(curves.mean(axis=0), 2)}  ({len(curves)} coolings, IN718 wall)'
        )
    print(
        f'{"simulated wall, 8 layers":34s} {np.round(np.mean(simulated_cooling(), axis=0), 2)}  (steel)'
    )


if __name__ == '__main__':
    main()
