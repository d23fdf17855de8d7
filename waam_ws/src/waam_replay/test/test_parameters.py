"""Parameters: YAML, dataclass and README agree."""

import dataclasses
from pathlib import Path

import yaml

from waam_node.params import markdown
from waam_replay.player_node import PlayerParams


def test_yaml_and_readme_list_every_parameter():
    file = Path(__file__).parents[1] / 'config/player.yaml'
    listed = yaml.safe_load(file.read_text())['/**/player']['ros__parameters']
    assert listed == {f.name: f.default for f in dataclasses.fields(PlayerParams)}
    assert markdown(PlayerParams) in file.parents[1].joinpath('README.md').read_text()
