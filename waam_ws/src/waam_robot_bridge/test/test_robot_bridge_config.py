"""The parameter file, the dataclass and the README agree; impossible values are refused by name."""

import dataclasses
from pathlib import Path

import pytest
import yaml

from waam_node.params import ParameterError, from_dict, markdown
from waam_robot_bridge.params import RobotParams

PACKAGE = Path(__file__).parents[1]


def test_the_yaml_lists_every_parameter_with_its_default():
    text = (PACKAGE / 'config/bridge.yaml').read_text()
    loaded = yaml.safe_load(text)['bridge']['ros__parameters']
    assert repr(from_dict(RobotParams, loaded)) == repr(RobotParams())  # NaN differs from NaN
    assert list(loaded) == [f.name for f in dataclasses.fields(RobotParams)]


def test_the_readme_has_the_parameter_table():
    assert markdown(RobotParams) in (PACKAGE / 'README.md').read_text()


@pytest.mark.parametrize(
    ('values', 'named'),
    [
        ({'joint_names': ('a', 'b')}, "'joint_names' has 2 values, needs 8"),
        ({'origin': (0.0,)}, "'origin' has 1 values, needs 3"),
        ({'period': 0.5}, "'period' is 0.5, must be below 'horizon'"),
        ({'joint_speed_max': (1.0,) * 7 + (0.0,)}, "'joint_speed_max'"),
        ({'joint_names': ('a',) * 8}, "'joint_names'"),
    ],
)
def test_impossible_values_are_refused(values, named):
    with pytest.raises(ParameterError, match=named):
        from_dict(RobotParams, values)


def test_the_box_of_the_robot_narrows_the_limits():
    params = RobotParams(work_low=(0.05, 0.0, -1.0), work_high=(0.35, 0.9, 0.2))
    limits = params.limits((0.0, 0.0, 0.0, 400.0, 300.0, 200.0))
    assert limits.low == (0.05, 0.0, 0.0)
    assert limits.high == pytest.approx((0.35, 0.3, 0.2))
