import dataclasses
from pathlib import Path

import pytest
import yaml

from waam_node.params import ParameterError, from_dict
from waam_scan.fusion.limits import FusionLimits
from waam_scan.fusion.plausibility import PlausibilityLimits
from waam_scan.fusion_params import FusionParams
from waam_scan.transform import Mounting

HERE = Path(__file__).parents[1]


def test_the_yaml_lists_every_parameter_with_its_default():
    text = yaml.safe_load((HERE / 'config/scan_fusion.yaml').read_text())
    listed = text['/**/scan_fusion']['ros__parameters']
    params = from_dict(FusionParams, listed)
    assert set(listed) == {f.name for f in dataclasses.fields(FusionParams)}
    assert params == FusionParams()


def test_defaults_agree_with_the_core():
    p = FusionParams()
    assert p.fusion == FusionLimits()
    assert p.plausibility == PlausibilityLimits()
    assert (p.mounting.rotation == Mounting().rotation).all()
    assert (p.mounting.offset == Mounting().offset).all()


@pytest.mark.parametrize(
    'values, word',
    [({'max_growth': 0.0}, 'max_growth'), ({'threads': 0}, 'threads'), ({'thread': 3}, 'threads')],
)
def test_bad_parameters_are_refused_by_name(values, word):
    with pytest.raises(ParameterError, match=word):
        from_dict(FusionParams, values)
