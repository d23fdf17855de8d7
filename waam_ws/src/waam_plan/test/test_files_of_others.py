"""Inputs that others brought, beside the checkout: each gives what is right for it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from waam_plan.import_gcode.files import load_program
from waam_plan.mesh.clouds import read_cloud
from waam_plan.mesh.inputs import flat
from waam_plan.mesh.part import PartError, load_part
from waam_plan.settings import PlanSettings

CLOUDS = {  # file: points, words in the notes, lowest height, mm
    'zeros_no_return.xyz': (7861, '1940 points at .* mark for no return', 4.78),
    'semicolon_comma.csv': (9801, 'decimal commas', 4.78),
    'random_comma.csv': (None, 'decimal commas', 4.78),
    'pcl_padded.pcd': (9801, '', 4.78),
}
REFUSED = {
    'metres.xyz': r'wrong units.*--scale 1 \(m\)',
    'inch.xyz': r'wrong units.*--scale 0.0254 \(inch\)',
    'compressed.pcd': r'9801 points .* the compressed data hold 0 bytes; save it as',
    'comma.3mf': 'object 1, vertex 0: x: .*decimal comma',
    'decimal_comma.stl': "line 4: '0,000000e[+]00' has a decimal comma",
    'one_body_inverted.stl': 'body 2 of 2 .* around .* is inside out',
    'metres.stl': r'wrong units.*--scale 1 \(m\)',
}
MESHES = {  # file: volume, cm3, words in the report
    'split_model.3mf': (14.4, ''),
    'split_model_otherid.3mf': (14.4, ''),
    'split_model_sameid.3mf': (14.4, ''),
    'mirrored.3mf': (7.65, ''),
    'inch_moved.3mf': (15.4, ''),
    'cracks.stl': (7.65, 'welded'),
    'solid_facet_binary.stl': (14.4, ''),
    'thin_and_block.stl': (15.1, ''),
}
PROGRAMS = {'m83_before_g90.gcode': (10, 'G90 after M83'), 'klipper_nonascii.gcode': (10, '')}


@pytest.fixture(scope='module')
def others() -> Path:
    folder = Path(__file__).resolve().parents[5] / 'shared' / 'data' / 'files_of_others'
    if not folder.is_dir():
        pytest.skip(f'no {folder}')
    return folder


def test_every_file_of_the_folder_is_named_here(others):
    here = {*CLOUDS, *REFUSED, *MESHES, *PROGRAMS, 'README.md'}
    assert {f.name for f in others.iterdir()} <= here


@pytest.mark.parametrize('name', CLOUDS)
def test_clouds(others, name):
    count, words, low = CLOUDS[name]
    cloud = read_cloud(others / name)
    assert count is None or len(cloud.points) == count
    assert re.search(words, ' '.join(cloud.notes))
    zone = flat(cloud, PlanSettings())
    assert -zone.offset[2] * 1e3 == pytest.approx(low, abs=0.05)
    assert np.ptp(cloud.points, axis=0)[:2] * 1e3 == pytest.approx((60, 40), abs=12)


@pytest.mark.parametrize('name', REFUSED)
def test_what_is_refused_names_cause_and_remedy(others, name):
    cloud = name.endswith(('.xyz', '.pcd'))
    with pytest.raises(PartError, match=REFUSED[name]):
        (read_cloud if cloud else load_part)(others / name)


@pytest.mark.parametrize('name', MESHES)
def test_meshes(others, name):
    volume, words = MESHES[name]
    part = load_part(others / name)
    assert part.report.volume * 1e6 == pytest.approx(volume, abs=0.1)
    assert words in ' '.join(part.report.lines())


def test_one_inverted_body_is_repaired_on_request(others):
    part = load_part(others / 'one_body_inverted.stl', repair=True)
    assert part.report.volume * 1e6 == pytest.approx(16.8, abs=0.1)
    assert 'body 2 of 2' in ' '.join(part.report.repairs)


@pytest.mark.parametrize('name', PROGRAMS)
def test_programs(others, name):
    beads, words = PROGRAMS[name]
    program = load_program(others / name, 'slicer')
    assert len(program.burning) == beads and words in ' '.join(program.remarks)
