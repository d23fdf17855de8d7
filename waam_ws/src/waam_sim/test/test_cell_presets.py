"""The presets of the cell: three files with what differs, within limits, each value with its source beside it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
import yaml

from waam_node.params import from_dict
from waam_process.operating import DEFAULT_PRESET, PRESETS, check_preset
from waam_sim import part
from waam_sim.config import CellParams, plant_params
from waam_sim.drive import Drive
from waam_sim.plant import Plant, PlantParams

FOLDER = Path(__file__).parents[1] / 'config' / 'presets'
USUAL = {f.name: f.default for f in dataclasses.fields(CellParams)}


def values(name: str) -> dict:
    return yaml.safe_load((FOLDER / f'{name}.yaml').read_text())['/**/cell']['ros__parameters']


def test_there_is_a_file_for_every_preset_and_no_other():
    assert sorted(f.stem for f in FOLDER.iterdir()) == sorted(PRESETS)
    assert DEFAULT_PRESET in PRESETS


@pytest.mark.parametrize('name', PRESETS)
def test_a_preset_loads_and_is_within_the_limits(name):
    made = from_dict(CellParams, values(name), 'cell')
    assert plant_params(made).metal.cell == PlantParams().metal.cell


def test_gentle_is_the_cell_of_the_packaged_parameters():
    said = values('gentle')
    assert said == {k: USUAL[k] for k in said}
    assert plant_params(from_dict(CellParams, said)) == PlantParams()


def test_gentle_lists_what_the_others_change_and_they_list_only_what_differs():
    others = [values(name) for name in PRESETS if name != 'gentle']
    assert set(values('gentle')) == set().union(*others)
    for other in others:
        assert [k for k, v in other.items() if v == USUAL[k]] == []


@pytest.mark.parametrize('name', [n for n in PRESETS if n != 'gentle'])
def test_every_value_has_its_source_beside_it(name):
    for line in (FOLDER / f'{name}.yaml').read_text().splitlines():
        if line.startswith('    ') and not line.lstrip().startswith('#'):
            assert len(line.partition('#')[2].split()) >= 3, line


def test_presets_are_one_rougher_than_the_other():
    scatter = (
        'metal_area_noise_fixed',
        'metal_area_noise_layer',
        'variation_lateral',
        'arc_drift_current',
    )
    gentle, recorded, rough = (values(name) for name in PRESETS)
    for name in scatter:
        assert gentle[name] < recorded[name] <= rough.get(name, recorded[name]), name


def test_an_unknown_preset_is_refused_naming_the_three():
    with pytest.raises(ValueError, match="'wild'.*gentle, recorded, rough"):
        check_preset('wild')


def test_a_rough_cell_lays_rougher_beads():
    spread = []
    for name in PRESETS:
        physics = plant_params(from_dict(CellParams, values(name)))
        plant = Plant(part.plate(0.09, 0.03, 0.01, 4e-4, 5e-3), physics, 3)
        Drive(plant, (0.0, 0.0, 0.03)).bead([(0.01, 0.015, 0.01), (0.08, 0.015, 0.01)], 0.01)
        inside = (plant.metal.spec.x > 0.025) & (plant.metal.spec.x < 0.065)
        spread.append(float(plant.metal.z[:, inside].max(axis=0).std()))
    assert spread[0] < spread[1] and spread[0] < spread[2]
