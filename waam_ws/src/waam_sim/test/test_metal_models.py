"""Metal models of different structure behind one interface: each keeps its metal and makes beads, walls and pads."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from laid_beads import WIRE, across, pad, track

from waam_node.params import ParameterError, from_dict
from waam_sim.config import CellParams, plant_params
from waam_sim.drive import Drive
from waam_sim.metal_models import MODELS
from waam_sim.metal_params import MetalParams
from waam_sim.part import plate
from waam_sim.plant import Plant, PlantParams

PITCH = 4.2e-3  # m, 0.60 of a bead: that of the plans
models = pytest.mark.parametrize('model', MODELS)
fast = settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(scope='module')
def single():
    """single(model) -> (plant, readings): one bead of 60 mm, without scatter."""
    kept = {}

    def make(model: str):
        if model not in kept:
            quiet = {'area_noise_fixed': 0.0, 'area_noise_layer': 0.0, 'width_noise': 0.0}
            params = PlantParams(metal=MetalParams(model=model, **quiet))
            plant = Plant(plate(0.1, 0.06, 0.02, 4e-4, 0.015), params, 1)
            drive = Drive(plant, (0.0, 0.0, 0.05))
            kept[model] = plant, drive.bead(track(0.03, 0.02, length=0.06), 0.01, WIRE)
        return kept[model]

    return make


def test_an_unknown_model_is_refused_by_name():
    with pytest.raises(ParameterError, match="metal_model.*'foam'.*portions, sections, film"):
        from_dict(CellParams, {'metal_model': 'foam'})
    with pytest.raises(ValueError, match="metal_model is 'foam', known are portions"):
        Plant(plate(0.02, 0.02, 0.01, 4e-4, 2e-3), PlantParams(metal=MetalParams(model='foam')))


def test_the_parameter_reaches_the_cell():
    physics = plant_params(from_dict(CellParams, {'metal_model': 'film', 'metal_levelling': 0.3}))
    plant = Plant(plate(0.02, 0.02, 0.01, 4e-4, 2e-3), physics)
    assert plant.metal.params['levelling'][0] == 0.3


@models
@fast
@given(
    points=st.lists(
        st.tuples(st.floats(-0.01, 0.11), st.floats(-0.01, 0.07)), min_size=2, max_size=4
    ),
    speed=st.floats(0.003, 0.03),
    wire=st.floats(0.03, 0.2),
    seed=st.integers(0, 1000),
)
def test_no_regime_and_no_path_makes_or_loses_metal(make_cell, model, points, speed, wire, seed):
    plant = make_cell(seed=seed, noise=True, model=model)
    before = plant.metal.volume
    Drive(plant, (*points[0], 0.05)).bead([(x, y, 0.02) for x, y in points], speed, wire)
    s = plant.metal.state[0]
    gained = plant.metal.volume - before
    assert gained == pytest.approx(s['deposited'] - s['lost'], rel=1e-6, abs=1e-15) or (
        model == 'portions' and gained == pytest.approx(s['deposited'], rel=1e-9, abs=1e-18)
    )
    assert np.isfinite(plant.metal.z).all()
    assert plant.metal.z.max() < 0.02 + 0.03, 'no needles'


@models
def test_volume_is_the_wire_times_the_transfer(single, model):
    plant, readings = single(model)
    p = plant.params
    fed = sum(r.wire_speed for r in readings) * 0.01 * p.arc.wire_ratio
    wire = fed * math.pi / 4 * p.metal.wire_diameter**2
    # until the arc strikes the wheel turns, and after it the drive runs out: some milliseconds of wire
    share = plant.metal.deposited / wire
    ours, _ = single('portions')
    assert share == pytest.approx(p.metal.transfer, rel=0.03)
    assert plant.metal.deposited == pytest.approx(ours.metal.deposited, rel=0.01)


@models
def test_a_single_bead_has_the_height_and_width_of_the_reference_point(single, model):
    plant, _ = single(model)
    z = across(plant, 0.055)
    area, height = z[z > 0].sum() * 4e-4, z.max()
    usual = across(single('portions')[0], 0.055)
    assert height == pytest.approx(usual.max(), rel=0.05)
    assert area == pytest.approx(usual[usual > 0].sum() * 4e-4, rel=0.01)
    assert 1.5 * area / height == pytest.approx(float(plant.metal.state['width'][0]), rel=0.05)
    assert np.count_nonzero(z > 0.05 * height) * 4e-4 == pytest.approx(6.4e-3, abs=0.9e-3)


@models
def test_beads_are_wide_where_the_torch_is_slow(make_cell, model):
    def seen(speed: float) -> tuple[float, float]:
        plant = make_cell(model=model)
        Drive(plant, (0.0, 0.0, 0.05)).bead(track(0.03, 0.02), speed, WIRE)
        z = across(plant, 0.055)
        return np.count_nonzero(z > 0.1e-3) * 4e-4, z.max()

    (wide, high), (narrow, low) = seen(0.007), seen(0.014)
    exponent = math.log(narrow / wide) / math.log(2)
    assert -0.85 < exponent < -0.35
    assert high > low


@models
def test_a_wall_grows_layer_by_layer(make_cell, model):
    plant = make_cell(model=model)
    growth = np.diff(pad(plant, 1, 8, PITCH))
    assert (growth > 1.0e-3).all() and (growth < 2.1e-3).all()
    assert growth[4:].std() < 0.05 * growth[4:].mean()
    z = across(plant, 0.05)
    half = np.count_nonzero(z > 0.5 * z.max()) * 4e-4
    assert 4.5e-3 < half < 9e-3, 'as wide as a bead'


@models
def test_parallel_beads_become_a_flat_layer(make_cell, model):
    plant = make_cell(model=model)
    before = plant.metal.volume
    tops = pad(plant, 9, 2, PITCH)
    spec = plant.metal.spec
    middle = (np.abs(spec.x - 0.05) < 0.01)[None] & (np.abs(spec.y - 0.03) < 0.012)[:, None]
    assert plant.metal.z[middle].std() < 0.13e-3
    area = (plant.metal.volume - before) / (18 * 0.05 + 16 * PITCH)  # with the links
    assert np.diff(tops) == pytest.approx(area / PITCH, rel=0.06)
    far = make_cell(model=model)
    pad(far, 5, 1, 8e-3)
    assert across(far, 0.05)[np.abs(spec.y - 0.03) < 0.012].min() < 0.2e-3, 'they stay apart'


@models
def test_ends_move_metal_each_in_its_way(single, model):
    plant, _ = single(model)
    row = int(plant.metal.spec.cell(0.05, 0.03)[0])
    along, x = plant.metal.z[row] - 0.02, plant.metal.spec.x
    steady = along[np.abs(x - 0.05) < 0.005].mean()
    start, end = along[(x > 0.018) & (x < 0.032)], along[(x > 0.074) & (x < 0.082)]
    if model == 'portions':
        assert start.max() > 1.15 * steady and end.max() < 1.1 * steady
    elif model == 'sections':
        assert end.max() > 1.08 * steady, 'the pool is laid as a cap'
        assert start.max() < 1.1 * steady
    else:
        assert 1.05 * steady < start.max() < 1.3 * steady and end.max() < 1.02 * steady
    assert across(plant, 0.0795).max() < 1.3 * steady, 'no needle'


@models
def test_a_torch_that_stands_makes_no_tower(make_cell, model):
    plant = make_cell(model=model)
    drive = Drive(plant, (0.05, 0.03, 0.02))
    drive.wait(0.1, outputs=2)
    drive.wait(1.5, WIRE, 22.0, 3)
    drive.wait(0.1, outputs=2)
    assert plant.metal.deposited > 50e-9
    assert plant.metal.z.max() - 0.02 < 9e-3


@models
def test_metal_at_the_edge_of_a_part_stays_with_it(make_cell, model):
    plant = make_cell(model=model)
    Drive(plant, (0.0, 0.0, 0.05)).bead(track(0.0585, 0.02), 0.01, WIRE)
    z, y = across(plant, 0.055), plant.metal.spec.y
    beside = (z[y > 0.06] + 0.02).sum() / np.where(y > 0.06, z + 0.02, z).clip(min=0).sum()
    assert 0.0 <= beside < 0.5


@models
def test_a_seed_fixes_everything(make_cell, model):
    def run(seed: int) -> np.ndarray:
        plant = make_cell(seed=seed, noise=True, model=model)
        Drive(plant, (0.0, 0.0, 0.05)).bead(track(0.03, 0.02, length=0.02), 0.01, WIRE)
        return plant.metal.z

    a, b, c = run(5), run(5), run(6)
    assert np.array_equal(a, b) and not np.array_equal(a, c)


def test_the_models_are_not_one_model(single):
    tops = [across(single(m)[0], 0.0255) for m in MODELS]
    for i in range(3):
        for j in range(i):
            assert np.abs(tops[i] - tops[j]).max() > 0.1e-3
