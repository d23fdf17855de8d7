"""What was laid stays on the table when the cell is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from waam_process.grid import GridSpec, HeightGrid
from waam_sim import part
from waam_sim.drive import Drive
from waam_sim.plant import Plant, PlantParams
from waam_sim.table import keep, kept_shaft, restore

SPEC = GridSpec(-1e-3, 2e-3, 0.5e-3, 7, 9)


def surface() -> HeightGrid:
    return HeightGrid(SPEC, np.arange(63.0).reshape(7, 9) * 1e-3)


def test_what_is_written_into_the_array_is_found_again(tmp_path):
    z = keep(surface(), tmp_path / 'table.npy')
    z[3, 4] = 0.5
    found = restore(tmp_path / 'table.npy')
    assert found.spec == SPEC and found.z[3, 4] == 0.5
    assert (np.delete(found.z.ravel(), 31) == np.delete(surface().z.ravel(), 31)).all()


def test_a_shaft_is_known_again(tmp_path):
    file = tmp_path / 'table.npy'
    keep(surface(), file, (0.04, 0.01))
    assert restore(file).spec == SPEC and kept_shaft(file) == (0.04, 0.01)
    keep(surface(), file)
    assert kept_shaft(file) is None is kept_shaft(tmp_path / 'gone.npy')


def test_a_killed_process_leaves_its_metal(tmp_path):
    code = (
        'import sys, time, numpy as np; from pathlib import Path; from waam_sim.table import keep\n'
        'from waam_process.grid import GridSpec, HeightGrid\n'
        'z = keep(HeightGrid(GridSpec(0.0, 0.0, 1e-3, 4, 4), np.zeros((4, 4))), Path(sys.argv[1]))\n'
        'z[1, 2] = 0.25\nprint("laid", flush=True); time.sleep(60)'
    )
    file = tmp_path / 'table.npy'
    process = subprocess.Popen(
        [sys.executable, '-c', code, file], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == 'laid\n'
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert restore(file).z[1, 2] == 0.25


def test_a_bead_on_a_kept_table_is_the_bead_on_a_plain_one(tmp_path):
    params = PlantParams()
    params = replace(params, metal=replace(params.metal, cell=0.5e-3))
    laid = []
    for table in (None, tmp_path / 'table.npy'):
        plate = part.plate(0.05, 0.03, 0.01, params.metal.cell, params.metal.margin)
        plant = Plant(plate, params, 3)
        plant.load(plate, 3, table)
        drive = Drive(plant, (0.01, 0.015, 0.03))
        drive.bead([(0.01, 0.015, 0.01), (0.04, 0.015, 0.01)], 0.01)
        laid.append(plant.metal.grid().z)
    assert laid[0].max() > 0.011
    assert np.array_equal(laid[0], laid[1])
    assert np.array_equal(restore(tmp_path / 'table.npy').z, laid[1])


@pytest.mark.parametrize('damage', ['none', 'torn', 'geometry', 'shape'])
def test_nothing_usable_is_nothing(tmp_path, damage):
    file = tmp_path / 'table.npy'
    keep(surface(), file)
    if damage == 'none':
        file.unlink()
    elif damage == 'torn':
        file.write_bytes(file.read_bytes()[:-9])
    elif damage == 'geometry':
        (tmp_path / 'table.npy.json').write_text('[1, 2')
    else:
        (tmp_path / 'table.npy.json').write_text('[0, 0, 0.001, 3, 3]')
    assert restore(file) is None
