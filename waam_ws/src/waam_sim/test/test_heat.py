"""Heat: balance, accumulation over layers, cooling, and what hot metal does to beads."""

from __future__ import annotations

import numpy as np
import pytest

from waam_sim.drive import Drive
from waam_sim.pool import bead_width

TRACKS = [(0.02, 0.03, 0.02), (0.08, 0.03, 0.02)]


def pad(drive: Drive, z: float) -> None:
    path = []
    for i in range(5):
        y = 0.03 + (i - 2) * 4.38e-3
        ends = [(0.02, y, z), (0.08, y, z)]
        path += ends[::-1] if i % 2 else ends
    drive.bead(path, 0.01)


def test_heat_balance_closes(make_cell):
    plant = make_cell()
    drive = Drive(plant, (0.0, 0.0, 0.05))
    pad(drive, 0.02)
    drive.wait(30.0)
    s = plant.heat.state[0]
    into = plant.params.heat.arc_efficiency * s['arc_energy']
    assert into > 20e3
    assert plant.heat.content + s['lost'] + s['missed'] == pytest.approx(into, rel=1e-6)


def test_layers_accumulate_and_pauses_cool(make_cell):
    plant = make_cell(size=(0.1, 0.06, 0.025))
    drive = Drive(plant, (0.0, 0.0, 0.06))
    after, rested = [], []
    for layer in range(3):
        pad(drive, 0.025 + layer * 1.8e-3)
        after.append(plant.heat.mean)
        drive.move((0.0, 0.0, 0.08), 0.05)
        cooling = []
        for _ in range(30):
            drive.wait(1.0)
            cooling.append(plant.heat.mean)
        assert (np.diff(cooling) < 0).all()
        rested.append(cooling[-1])
    assert after == sorted(after) and rested == sorted(rested)
    assert 40 < after[0] - 22 < 150, (
        'a layer of some 30 s raises the mean by some tens to a hundred kelvin'
    )
    assert all(5 < a - r < 80 for a, r in zip(after, rested, strict=True))


def test_part_ends_at_ambient(make_cell):
    plant = make_cell(size=(0.04, 0.03, 0.006))
    drive = Drive(plant, (0.0, 0.0, 0.05))
    drive.bead([(0.01, 0.015, 0.006), (0.03, 0.015, 0.006)], 0.01)
    hot = plant.heat.mean
    drive.wait(250.0)
    assert hot > 60.0 and plant.heat.mean == pytest.approx(22.0, abs=2.0)
    assert plant.heat.skin.min() > 21.9


def test_hot_metal_makes_wider_lower_beads(make_cell):
    p = make_cell().metal.params[0]
    assert bead_width(p, 2500.0, 0.01, 350.0) > 1.05 * bead_width(p, 2500.0, 0.01, 100.0)
    shapes = []
    for start in (22.0, 350.0):
        plant = make_cell()
        plant.heat.skin[:] = plant.heat.bulk[:] = start
        Drive(plant, (0.0, 0.0, 0.05)).bead(TRACKS, 0.01)
        z = plant.metal.z[:, int(plant.metal.spec.cell(0.055, 0.03)[1])] - 0.02
        shapes.append((z.max(), (z > 1e-4).sum()))
    assert shapes[1][0] < 0.93 * shapes[0][0] and shapes[1][1] > shapes[0][1]


def test_the_arc_is_hottest_where_it_was_last(make_cell):
    plant = make_cell()
    Drive(plant, (0.0, 0.0, 0.05)).bead(TRACKS, 0.01)
    assert plant.heat.at(0.078, 0.03) > plant.heat.at(0.05, 0.03) > plant.heat.at(0.01, 0.055)
    assert plant.heat.at(-1.0, 0.0) == 22.0
