"""Where the parameters come from, and how bad ones are told."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from waam_lab import params
from waam_node.params import ParameterError
from waam_process.operating import DEFAULT_PRESET


def test_defaults_are_those_that_the_graph_starts_its_nodes_with():
    graph = Path(__file__).parents[2]
    for node, (package, _) in params.NODES.items():
        name = node.removeprefix('robot_')  # a robot's bridge is the node `bridge` as well
        file = graph / package / 'config' / f'{name}.yaml'
        assert (
            params.defaults(node)
            == yaml.safe_load(file.read_text())[f'/**/{name}']['ros__parameters']
        )
    made = params.make()
    law = yaml.safe_load((graph / 'waam_adapt/config/correction_server.yaml').read_text())
    assert made.correction_server.law == law['/**/correction_server']['ros__parameters']['law']


def test_later_overrides_win():
    first, second = (
        {'correction_server': {'gain': 0.5, 'learning': 0.1}},
        {'correction_server': {'gain': 0.7}},
    )
    made = params.make(first, second).correction_server
    assert (made.gain, made.learning) == (0.7, 0.1)


def test_a_preset_comes_after_the_files_and_before_the_overrides():
    usual, rough = params.make(preset='gentle').cell, params.make(preset='rough').cell
    assert params.make().cell == params.make(preset=DEFAULT_PRESET).cell
    assert usual.metal_area_noise_layer == params.defaults('cell')['metal_area_noise_layer']
    assert rough.metal_area_noise_layer > 1.5 * usual.metal_area_noise_layer
    own = params.make({'cell': {'metal_area_noise_layer': 0.01}}, preset='rough').cell
    assert own.metal_area_noise_layer == 0.01
    assert own.metal_area_noise_fixed == rough.metal_area_noise_fixed
    with pytest.raises(ValueError, match='gentle, recorded, rough'):
        params.make(preset='wild')


def test_no_heartbeat_is_asked_for():
    assert params.make().job_sequencer.lease_nodes == ()


@pytest.mark.parametrize(
    'text,words',
    [
        ('gain=1', 'node.parameter=value'),
        ('correction_server.gain', 'node.parameter=value'),
        ('corection_server.gain=1', "did you mean 'correction_server'"),
        ('correction_server.gian=1', "did you mean 'gain'"),
    ],
)
def test_a_setting_that_is_not_understood_is_named(text, words):
    with pytest.raises(ParameterError, match=words) as told:
        params.parse_settings([text])
    assert text in str(told.value) or text.split('=')[0] in str(told.value)


def test_settings_are_numbers_words_and_switches():
    found = params.parse_settings(
        [
            'correction_server.gain=0.8',
            'correction_server.law=unet',
            'correction_server.identify=false',
        ]
    )
    assert found == {'correction_server': {'gain': 0.8, 'law': 'unet', 'identify': False}}


@pytest.mark.parametrize(
    'text', ['', '- 1\n', 'cell: 3\n', 'cell: {metal_transfer: 0.9}\n', 'a: [', '\x00']
)
def test_a_file_that_is_no_parameter_file_is_named(tmp_path, text):
    file = tmp_path / 'cell.yaml'
    file.write_text(text)
    with pytest.raises(ParameterError, match='cell.yaml'):
        params.read_file(file)
    with pytest.raises(ParameterError, match='gone.yaml'):
        params.read_file(tmp_path / 'gone.yaml')
