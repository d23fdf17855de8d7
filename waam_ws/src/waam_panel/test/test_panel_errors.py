"""The error map of the page is that of the newest scan's own layer, also after a rescan and after a resume."""

from __future__ import annotations

import asyncio
import base64
from array import array
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose

from waam_msgs.msg import GridInfo, HeightMap
from waam_node import job_folder
from waam_panel import conversions
from waam_panel.cell import Cell
from waam_panel.parts import PartFolders
from waam_panel.security import Guard
from waam_panel.state import PanelState
from waam_process.grid import GridSpec
from waam_view.mailbox import Mailbox

SPEC = GridSpec(0.01, 0.02, 1e-3, 6, 8)
REACH = 0.6e-3
ERRORS = (1e-4, 2e-4, 3e-4, 4e-4)  # m, of the surfaces that the job has stored after each layer


def scan(run: int, scan_id: int, layer: int, error: float, job: str = 'job') -> HeightMap:
    z = np.full(SPEC.shape, 0.002 * layer + error, np.float32)
    corner = Pose(position=Point(x=SPEC.origin_x, y=SPEC.origin_y))
    grid = GridInfo(resolution=SPEC.resolution, rows=SPEC.rows, cols=SPEC.cols, origin=corner)
    return HeightMap(job_id=job_folder.run_id(job, run), scan_id=scan_id, layer=layer, grid=grid,
                     z=array('f', z.tobytes()), plausible=True)  # fmt: skip


@pytest.fixture
def cell(tmp_path: Path):
    (tmp_path / job_folder.MAPS).mkdir()
    for layer in range(4):
        target = np.full(SPEC.shape, 0.002 * layer)
        np.savez(tmp_path / job_folder.map_after(layer), z=target + ERRORS[layer], target=target,
                 layer=layer, resolution=SPEC.resolution,
                 origin=np.array([SPEC.origin_x, SPEC.origin_y]))  # fmt: skip
    made = Cell(
        guard=Guard.create(None, '127.0.0.1', 0, ()), state=PanelState(60), operations=None,
        mailbox=Mailbox(), convert=lambda _, m: m, parts=PartFolders((tmp_path,)), jobs_dir=tmp_path,
        materials=(), error_range=REACH,
    )  # fmt: skip
    made.state.sections['job'] = {'id': 'job', 'dir': str(tmp_path)}
    yield made
    made.close()


def show(cell: Cell, message: HeightMap) -> dict | None:
    """The error map after this scan."""
    cell.state.scan = conversions.height(message)
    asyncio.run(cell._judge())
    return cell.state.maps.get('error', (0, None))[1]


def microns(picture: dict) -> float:
    """The one value of a map of a constant."""
    values = np.frombuffer(base64.b64decode(picture['data']), '<i2')
    assert np.ptp(values) <= 1
    return float(values[0])


def test_every_scan_is_judged_by_its_own_layer(cell):
    rescanned = [(1, 0, 0, 1e-4), (1, 1, 1, 2e-4), (1, 2, 1, 2e-4), (1, 3, 2, 3e-4)]
    errors = [*rescanned, (2, 0, 2, 3e-4), (2, 1, 2, -1e-4)]  # resumed, scanned again
    for run, scan_id, layer, error in errors:
        shown = show(cell, scan(run, scan_id, layer, error))
        assert microns(shown) == pytest.approx(error * 1e6, abs=1), (run, scan_id, layer)
        assert f'after layer {layer}:' in shown['title']


def test_the_worst_place_and_what_is_beyond_the_colours_are_told(cell):
    shown = show(cell, scan(1, 0, 1, 1e-4))
    assert 'beyond' not in shown['title']
    assert all('+0.10 mm at x' in place['words'] for place in shown['places'])
    message = scan(1, 1, 2, 3e-4)
    message.z[2 * SPEC.cols + 3] += 0.5e-3
    shown = show(cell, message)
    place = shown['places'][0]
    at = SPEC.origin_x + 3.5 * SPEC.resolution, SPEC.origin_y + 2.5 * SPEC.resolution, 0.0048
    assert place['at'] == pytest.approx([v * 1e3 for v in at], abs=1e-3)
    assert '+0.80 mm' in place['words'] and '2.1% of the judged area beyond' in shown['title']


def test_the_scan_of_another_job_is_not_judged_by_this_one(cell):
    assert show(cell, scan(1, 0, 0, 1e-4, job='another')) is None
