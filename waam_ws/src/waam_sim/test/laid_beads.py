"""Beads, walls and pads in the middle of a plate of 100 x 60 x 20 mm, and what they look like across."""

import numpy as np

from waam_sim.drive import Drive

WIRE = 5 / 60


def across(plant, x: float) -> np.ndarray:
    """Heights over the plate across the part at x."""
    column = int(plant.metal.spec.cell(x, 0.03)[1])
    return plant.metal.z[:, column] - 0.02


def track(y: float, z: float, back: bool = False, length: float = 0.05) -> list:
    ends = [(0.05 - length / 2, y, z), (0.05 + length / 2, y, z)]
    return ends[::-1] if back else ends


def pad(
    plant, beads: int, layers: int, pitch: float, speed: float = 0.01, wait: float = 40.0
) -> np.ndarray:
    """(layers + 1,) m: mean height of the middle before and after the layers of a zig-zag; the torch follows the
    surface."""
    drive, spec = Drive(plant, (0.0, 0.0, 0.06)), plant.metal.spec
    half = max((beads - 1) / 2 * pitch * 0.6, 2e-4) + 1e-4
    middle = (np.abs(spec.x - 0.05) < 0.01)[None] & (np.abs(spec.y - 0.03) <= half)[:, None]
    tops = [0.02]
    for layer in range(layers):
        path = []
        for b in range(beads):
            path += track(0.03 + (b - (beads - 1) / 2) * pitch, tops[-1], (b + layer) % 2 == 1)
        drive.bead(path, speed, WIRE)
        tops.append(float(plant.metal.z[middle].mean()))
        drive.wait(wait)
    return np.array(tops)
