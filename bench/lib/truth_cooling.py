"""Cooling of a thin wall between layers: excess temperature 10, 20 and 30 s after the arc over that 5 s after it.

Recorded: IN718 walls of 60 and 110 layers, a point of the wall (`interlayer_temperature`). Simulated: a thin wall of
the same metal that is as hot before a layer, read in its middle.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

AMBIENT = 22.0
AFTER = (5.0, 10.0, 20.0, 30.0)  # s
# IN718 at some hundred degrees: W/(m K), J/(m^3 K) (Mills, Recommended values of thermophysical properties, 2002)
IN718 = {'conductivity': 18.0, 'heat_capacity': 4.5e6}
WALL = (0.10, 0.006, 0.05)  # m, length, thickness, height
BEFORE = 550.0  # degC, the recorded walls before a layer (medians 554 and 548)
LAYERS = 3


def recorded(files: list[Path]) -> np.ndarray:
    """(3,) mean over all undisturbed coolings."""
    return np.mean([c for f in files for c in _curves(f)], axis=0)


def _curves(file: Path) -> list[np.ndarray]:
    with file.open() as f:
        a = np.array([[float(v) for v in row] for row in list(csv.reader(f))[1:]])
    t, celsius = a[np.isfinite(a[:, 1])].T
    found = []
    for i in range(40, len(t) - 40):
        if celsius[i] < celsius[i - 15 : i + 16].max() or celsius[i] < celsius[i + 25] + 60:
            continue
        at = np.interp(np.array(AFTER) + t[i], t, celsius) - AMBIENT
        if (np.diff(at) < 0).all():
            found.append(at[1:] / at[0])
    return found


def simulated(physics, seed: int) -> np.ndarray:
    """(3,), mean over the layers but the first."""
    from waam_process.grid import HeightGrid
    from waam_sim import part
    from waam_sim.drive import Drive
    from waam_sim.plant import Plant

    heat = replace(physics.heat, **IN718, initial=BEFORE)
    physics = replace(physics, heat=heat, arc=replace(physics.arc, strike_failure=0.0))
    plate = part.plate(0.14, 0.05, 0.01, 1e-3, 5e-3)
    x, y = np.meshgrid(plate.spec.x, plate.spec.y)
    on = (abs(x - 0.07) < WALL[0] / 2) & (abs(y - 0.025) < WALL[1] / 2)
    made = HeightGrid(plate.spec, np.where(on, plate.z + WALL[2], plate.z))
    plant = Plant(made, replace(physics, metal=replace(physics.metal, cell=1e-3)), seed)
    top, found = 0.01 + WALL[2], []
    drive = Drive(plant, (0.0, 0.0, top + 0.03))
    for layer in range(LAYERS):
        ends = [(0.025, 0.025, top), (0.115, 0.025, top)]
        drive.bead(ends[::-1] if layer % 2 else ends, 0.01)
        excess = []
        for pause in np.diff((0.0, *AFTER)):
            drive.wait(float(pause))
            excess.append(plant.heat.at(0.07, 0.025) - AMBIENT)
        found.append(np.array(excess[1:]) / excess[0])
        drive.wait(15.0)
        top = float(plant.metal.z.max())
    return np.mean(found[1:], axis=0)
