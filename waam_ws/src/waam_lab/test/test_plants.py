"""Random cells of the metal models: repeatable, within ranges that hold the packaged values, two sets of seeds."""

from __future__ import annotations

import numpy as np
import pytest

from waam_lab import plants
from waam_sim.drive import Drive
from waam_sim.metal_models import MODELS
from waam_sim.part import plate
from waam_sim.plant import Plant, PlantParams

models = pytest.mark.parametrize('model', MODELS)


@models
def test_ranges_hold_the_packaged_values_and_cells_lie_in_them(model):
    usual = PlantParams().metal
    drawn = [plants.family_plant(model, n).metal for n in range(40)]
    assert {m.model for m in drawn} == {model}
    for name, (low, high) in plants._OWN[model].items():
        values = np.array([getattr(m, name) for m in drawn])
        assert low <= getattr(usual, name) <= high
        assert (values >= low).all() and (values <= high).all()
        assert np.ptp(values) > 0.7 * (high - low)
    scatter = [m.area_noise_layer / usual.area_noise_layer for m in drawn]
    assert min(scatter) < 1.3 and max(scatter) > 2.3, 'up to what was recorded'


def test_cells_for_choosing_are_not_those_for_reporting():
    one, same = plants.family_plant('film', 3), plants.family_plant('film', 3, plants.CHOOSING)
    assert one == same
    assert one != plants.family_plant('film', 3, plants.REPORTING)
    with pytest.raises(ValueError, match='seeds is 1'):
        plants.family_plant('film', 3, 1)
    with pytest.raises(ValueError, match="'foam', known are portions, sections, film"):
        plants.family_plant('foam', 0)


@models
@pytest.mark.parametrize('cell', range(4))
def test_every_random_cell_lays_a_bead(model, cell):
    physics = plants.family_plant(model, cell)
    plant = Plant(plate(0.06, 0.04, 0.02, physics.metal.cell, 5e-3), physics, cell)
    before = plant.metal.volume
    Drive(plant, (0.0, 0.0, 0.05)).bead([(0.015, 0.02, 0.02), (0.045, 0.02, 0.02)], 0.01)
    gained = plant.metal.volume - before
    assert gained == pytest.approx(plant.metal.deposited, rel=1e-6)
    column = int(plant.metal.spec.cell(0.03, 0.02)[1])
    z = plant.metal.z[:, column] - 0.02
    assert 1.0e-3 < z.max() < 3.2e-3
    assert 4e-3 < np.count_nonzero(z > 0.1e-3) * physics.metal.cell < 10e-3
