"""Parts that warp while they are welded, and maps that are wrong because the part was moved."""

from __future__ import annotations

import numpy as np
import pytest

from waam_sim.drive import Drive
from waam_sim.placement import PlacementParams
from waam_sim.plant import OUTPUT_ARC, OUTPUT_GAS

ON = OUTPUT_ARC | OUTPUT_GAS
WIRE = 5 / 60


def lay(plant, lift: float = 0.0) -> Drive:
    drive = Drive(plant, (0.02, 0.03, 0.05))
    drive.bead([(0.02, 0.03, 0.02 + lift), (0.08, 0.03, 0.02 + lift)], 0.008)
    return drive


def scanned(plant, x: float) -> float:
    """Median height (m, work frame) that the scanner reports of the line at x."""
    offset = plant.params.scanner.offset_x
    plant.scanning = True
    drive = Drive(plant, (x - offset, 0.02, 0.03), plant.time_us + 10_000)
    drive.wait(0.2)
    plant.scanning = False
    z = np.concatenate([p.z for p in drive.profiles])
    return float(np.nanmedian(z)) + plant.params.scanner.offset_z + 0.03


def test_as_shipped_a_part_stays_as_it_was_scanned(make_cell):
    plant = make_cell()
    lay(plant)
    assert plant.placed.at(0.05, 0.03) == 0.0
    assert np.array_equal(plant.surface().z, plant.metal.z)


def warping(**changed) -> dict:
    return {'part': PlacementParams(warp=3e-3, warp_energy=8e3, warp_spread=0.0, **changed)}


def test_heat_lifts_the_part_around_the_arc_and_never_further_than_its_limit(make_cell):
    plant = make_cell(groups=warping())
    lay(plant)
    under, beside = plant.placed.at(0.06, 0.03), plant.placed.at(0.06, 0.055)
    assert 1.5e-3 < under < 3e-3
    assert 0.3 * under < beside < 0.9 * under
    for _ in range(3):
        lay(plant, 4e-3)
    assert 2.5e-3 < plant.placed.at(0.06, 0.03) <= 3e-3


def test_cooling_takes_back_what_does_not_stay(make_cell):
    plant = make_cell(groups=warping(warp_kept=0.3, warp_cooling=20.0))
    drive = lay(plant)
    hot = plant.placed.at(0.06, 0.03)
    drive.wait(120.0)
    cold = plant.placed.at(0.06, 0.03)
    assert 0.25 * hot < cold < 0.6 * hot
    kept = float(plant.placed.kept.max())
    assert float(plant.placed.hot.max()) < 0.01 * kept


def test_the_arc_meets_the_metal_where_it_is(make_cell):
    """A part that rises comes nearer to a torch that stays: less contact distance, more current."""
    current, distance = [], []
    for plant in (make_cell(), make_cell(groups=warping())):
        drive = Drive(plant, (0.03, 0.03, 0.022))
        drive.wait(0.1, outputs=OUTPUT_GAS)
        drive.wait(0.4, WIRE, 22.0, ON)
        seen = drive.move((0.07, 0.03, 0.022), 0.008, WIRE, 22.0, ON)
        current.append(np.mean([r.current for r in seen[-100:]]))
        distance.append(float(plant.arc.state['ctwd'][0]))
    rose = plant.placed.at(0.07, 0.03)
    assert rose > 1e-3
    assert distance[0] - distance[1] == pytest.approx(rose, abs=0.3e-3)
    assert current[1] - current[0] > 2e3 * rose  # some 3 A per mm


def test_scanner_and_distance_sensor_see_the_warped_part(make_cell):
    plant = make_cell(groups=warping())
    before = scanned(plant, 0.05)
    lay(plant)
    rose = plant.placed.at(0.05, 0.02)
    assert rose > 0.5e-3
    assert scanned(plant, 0.05) - before == pytest.approx(rose, abs=0.2e-3)
    drive = Drive(plant, (0.05, 0.02, 0.02), plant.time_us)
    seen = np.nanmean([r.distance for r in drive.wait(0.5)])
    assert 100.0 - seen == pytest.approx(1e3 * plant.placed.at(0.05, 0.02), abs=0.1)


def test_a_part_that_was_moved_shows_it_when_the_arc_burns(make_cell):
    moved = PlacementParams(moved_z=1e-3, moved_tilt_x=0.02, moved_step=3e-3, moved_step_x=0.05)
    plant = make_cell(groups={'part': moved})
    assert scanned(plant, 0.03) == pytest.approx(0.020, abs=0.05e-3)
    lay(plant)
    assert scanned(plant, 0.03) == pytest.approx(0.020 + 1e-3 - 0.4e-3, abs=0.05e-3)
    assert scanned(plant, 0.09) == pytest.approx(0.020 + 1e-3 + 0.8e-3 + 3e-3, abs=0.05e-3)
    assert plant.surface().z.min() == 0.0, 'the table stays where it is'


def test_parts_differ_by_their_seed(make_cell):
    params = PlacementParams(warp=3e-3, warp_energy=8e3)
    risen = set()
    for seed in (1, 2, 1):
        plant = make_cell(seed=seed, groups={'part': params})
        lay(plant)
        risen.add(plant.placed.at(0.06, 0.03))
    assert len(risen) == 2


def test_a_moved_part_lies_there_as_soon_as_its_scan_is_over(make_cell):
    """So that a torch that goes to its distance before the strike finds the part where it will weld."""
    plant = make_cell(groups={'part': PlacementParams(moved_z=2e-3)})
    assert scanned(plant, 0.05) == pytest.approx(0.020, abs=0.05e-3)
    drive = Drive(plant, (0.05, 0.02, 0.02), plant.time_us)
    seen = np.nanmean([r.distance for r in drive.wait(0.5)])
    assert seen == pytest.approx(98.0, abs=0.05)
