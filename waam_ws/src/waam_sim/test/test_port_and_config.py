"""The plant port against a fake controller, the parameter file, and the purity of the cores."""

from __future__ import annotations

import dataclasses
import re
import threading
from pathlib import Path

import numpy as np
import pytest
import yaml

from waam_node.params import ParameterError, from_dict, markdown
from waam_sim.config import CellParams, plant_params
from waam_sim.drive import Drive
from waam_sim.gantry import GantryParams
from waam_sim.plant import warm_up
from waam_sim.port import PlantPort, PortError

PACKAGE = Path(__file__).parents[1]
PURE = [
    'arc', 'compiled', 'config', 'disturbance', 'drive', 'faults', 'heat', 'metal', 'metal_film', 'metal_models',
    'metal_sections', 'part', 'plant', 'pool', 'port',
    'pyrometer', 'scanner', 'distance', 'placement', 'gantry',
    'variation',
]  # fmt: skip


def serve(path: str, plant, errors: list) -> threading.Thread:
    def live() -> None:
        port = PlantPort(path)
        try:
            while True:
                samples, time_us = port.receive()
                port.answer(plant.step(samples, time_us))
        except PortError as e:
            errors.append(str(e))
        finally:
            port.close()

    thread = threading.Thread(target=live, daemon=True)
    thread.start()
    return thread


def test_every_step_that_asks_gets_32_samples_of_the_accelerometer(controller, make_cell):
    errors = []
    plant = make_cell(groups={'gantry': GantryParams(on=True, sensor_noise=0.0)})
    warm_up(plant.params)
    serve(controller.path, plant, errors)
    controller.accept()
    still = np.zeros((10, 3)) + (0.02, 0.03, 0.05)
    _, inputs, *_ = controller.step(still)
    assert inputs & 64 and not len(controller.felt)
    counts, seen = [], []
    for k in range(200):
        controller.step(still + (1e-4 * (k % 2), 0.0, 0.0), outputs=4)
        counts.append(len(controller.felt))
        seen.append(controller.felt)
    assert counts == [32] * 200
    assert np.allclose(np.concatenate(seen)[:, 2], 9.80665, atol=0.02)
    assert abs(np.concatenate(seen)[:, 0]).max() > 1.0
    controller.step(still)
    assert not len(controller.felt) and errors == []


def test_port_gives_the_same_metal_as_direct_steps(controller, make_cell):
    over_port, direct, errors = make_cell(seed=4, noise=True), make_cell(seed=4, noise=True), []
    thread = serve(controller.path, over_port, errors)
    controller.accept()
    controller.position = np.array([0.02, 0.03, 0.02])
    controller.run((0.02, 0.03, 0.02), 0.4, wire=0.08, voltage=22.0, outputs=3)
    controller.run((0.04, 0.03, 0.02), 2.0, wire=0.08, voltage=22.0, outputs=3)
    assert over_port.time_us == controller.time_us
    *_, distance, reading, _ = controller.answers[-1]
    assert np.isclose(distance, over_port.distance.value, equal_nan=True)
    assert reading == over_port.distance.reading > 1000
    controller.client.close()
    thread.join(5)
    assert errors == ['the controller closed the plant port']

    drive = Drive(direct, (0.02, 0.03, 0.02), controller.time_us - 2_400_000)
    drive.wait(0.4, 0.08, 22.0, 3)
    drive.move((0.04, 0.03, 0.02), 0.01, 0.08, 22.0, 3)
    assert over_port.metal.deposited > 1e-9
    assert np.abs(over_port.metal.z - direct.metal.z).max() < 1e-9


def test_what_is_no_step_is_refused(controller, make_cell):
    errors = []
    thread = serve(controller.path, make_cell(), errors)
    controller.accept()
    with pytest.raises(ConnectionError):
        controller.step(np.zeros((10, 3)), magic=0x12345678)
    thread.join(5)
    assert 'not a step' in errors[0] and '0x12345678' in errors[0]


def test_numbers_that_are_not_finite_are_refused(controller, make_cell):
    errors = []
    thread = serve(controller.path, make_cell(), errors)
    controller.accept()
    controller.step(np.zeros((10, 3)))
    with pytest.raises(ConnectionError):
        controller.step(np.full((10, 3), np.nan))
    thread.join(5)
    assert 'not finite' in errors[0]


def test_nobody_listening_is_an_os_error(tmp_path):
    with pytest.raises(OSError):
        PlantPort(str(tmp_path / 'none'))


def test_yaml_lists_every_parameter_with_its_default():
    values = yaml.safe_load((PACKAGE / 'config' / 'cell.yaml').read_text())['/**/cell'][
        'ros__parameters'
    ]
    known = {f.name: f.default for f in dataclasses.fields(CellParams)}
    assert list(values) == list(known)
    for name, default in known.items():
        value = tuple(values[name]) if isinstance(values[name], list) else values[name]
        assert repr(value) == repr(default), name  # also of NaN, and of a type


def test_readme_has_the_table_of_parameters():
    assert markdown(CellParams) in (PACKAGE / 'README.md').read_text()


def test_parameters_reach_the_physics():
    params = plant_params(from_dict(CellParams, {'metal_levelling': 0.2, 'scanner_noise': 5e-5}))
    assert params.metal.levelling == 0.2 and params.scanner.noise == 5e-5
    with pytest.raises(ParameterError, match='arc_wire_lag'):
        from_dict(CellParams, {'arc_wire_lag': -1.0})
    with pytest.raises(ValueError, match='work_zero'):
        plant_params(from_dict(CellParams, {'work_zero': (0.1, 0.2)}))


@pytest.mark.parametrize('name', PURE)
def test_cores_are_free_of_ros_clocks_and_the_models_of_others(name):
    text = (PACKAGE / 'waam_sim' / f'{name}.py').read_text()
    for word in ('rclpy', '_msgs', 'import time', 'np.random.rand'):
        assert word not in text, word
    ours = set(re.findall(r'(?:from|import) (waam_[a-z_.]+)', text))
    # plant_port: the layout of the bytes that both exchange, no formula
    assert ours <= {'waam_process.grid', 'waam_process.plant_port', 'waam_node.params'}
