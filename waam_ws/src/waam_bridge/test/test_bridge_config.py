"""The parameter file, the dataclass and the README agree."""

import dataclasses
from pathlib import Path

import pytest
import yaml

from waam_bridge.params import BridgeParams
from waam_node.params import from_dict, markdown

PACKAGE = Path(__file__).parents[1]


def test_the_yaml_lists_every_parameter_with_its_default():
    loaded = yaml.safe_load((PACKAGE / 'config/bridge.yaml').read_text())['/**/bridge'][
        'ros__parameters'
    ]
    assert repr(from_dict(BridgeParams, loaded)) == repr(BridgeParams())  # NaN differs from NaN
    assert list(loaded) == [f.name for f in dataclasses.fields(BridgeParams)]


@pytest.mark.parametrize(('baud', 'bytes_'), [(921600, 2028), (115200, 256), (0, 2048)])
def test_an_override_waits_no_longer_than_22_ms_behind_segments(baud, bytes_):
    assert BridgeParams(baud=baud).window == bytes_


def test_the_readme_has_the_parameter_table():
    assert markdown(BridgeParams) in (PACKAGE / 'README.md').read_text()
