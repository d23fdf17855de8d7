"""Beads side by side on a plate of the simulated cell, each measured by the scanner before the next one is laid."""

from __future__ import annotations

import dataclasses

import numpy as np

WIDTH = 7.0e-3  # m, wanted
BEADS, PITCH, LENGTH = 8, 18e-3, 60e-3
SPEED, FEED, VOLTAGE = 10e-3, 5 / 60, 22.0
HEIGHT = 12e-3  # m, of the torch over the plate while scanning
STEP = 2e-3  # m between two looks at the pool


def beads(seed: int, controlled: bool) -> np.ndarray:
    """(BEADS, 3): true mean width without the ends, measured width, its uncertainty; m.

    The cell differs from its data sheet by up to 8 % of width, the plate warms up, contact tip and wire wander.
    """
    from waam_adapt.hold.width import WidthControl, WidthSettings
    from waam_sim.drive import Drive
    from waam_sim.part import plate
    from waam_sim.plant import Plant, PlantParams

    rng = np.random.default_rng([seed, 7])
    p = PlantParams()
    p = dataclasses.replace(
        p,
        metal=dataclasses.replace(p.metal, width_ref=7.0e-3 * rng.uniform(0.92, 1.08)),
        arc=dataclasses.replace(p.arc, tip_wander=1.2e-3, feed_wander=0.04),
    )
    top = 12e-3
    plant = Plant(plate(0.110, 0.170, top, p.metal.cell, p.metal.margin), p, seed)
    drive = Drive(plant, (0.02, 0.02, top + HEIGHT))
    control = WidthControl(WidthSettings(WIDTH, VOLTAGE, 16.0, 30.0))
    rows = []
    for i in range(BEADS):
        y = 0.02 + PITCH * i
        true = _lay(drive, plant, y, top, control.voltage if controlled else VOLTAGE)
        measured = _scan(drive, plant, y, top)
        rows.append((true, measured.width, measured.u))
        control.add(measured.width, measured.u)
        drive.wait(20.0)
    return np.array(rows)


def _lay(drive, plant, y: float, top: float, voltage: float) -> float:
    """Lays a bead along x and returns the mean width of its pool, without 10 mm at each end."""
    from waam_sim.plant import OUTPUT_ARC, OUTPUT_GAS

    drive.bead([(0.02, y, top)], SPEED, FEED, voltage)
    on = OUTPUT_ARC | OUTPUT_GAS
    drive.wait(0.1, outputs=OUTPUT_GAS)
    while not plant.arc_on:
        drive.wait(0.01, FEED, voltage, on)
    widths = []
    for x in np.arange(0.02 + STEP, 0.02 + LENGTH + 1e-9, STEP):
        drive.move((x, y, top), SPEED, FEED, voltage, on)
        if 0.03 < x < 0.01 + LENGTH:
            widths.append(float(plant.metal.state['width'][0]))
    drive.wait(0.2, outputs=OUTPUT_GAS)
    return float(np.mean(widths))


def _scan(drive, plant, y: float, top: float):
    """Profiles across the bead, as the scanner sees them, and the width that they show."""
    from waam_scan.bead_width import bead_width
    from waam_scan.transform import Mounting

    mount = Mounting()
    behind, z = -float(mount.offset[0]), top
    drive.move((drive.position[0], y, z + HEIGHT), 0.05)
    drive.move((0.02 + behind, y, z + HEIGHT), 0.05)
    drive.profiles.clear()
    plant.scanning = True
    begin = drive.time_us
    drive.move((0.02 + LENGTH + behind, y, z + HEIGHT), 0.05)
    plant.scanning = False
    share = [(p.time_us - begin) / (drive.time_us - begin) for p in drive.profiles]
    at = np.concatenate(share)
    heights = np.concatenate([p.z for p in drive.profiles])
    tcp = np.column_stack(
        [0.02 + behind + at * LENGTH, np.full(len(at), y), np.full(len(at), z + HEIGHT)]
    )
    lateral = np.broadcast_to(np.asarray(plant.scanner.lateral), heights.shape)
    points = mount.points(tcp, lateral, heights)
    return bead_width(points, (0.02, y), (0.02 + LENGTH, y))
