"""Parameters are refused by name, with the limit, before a node exists."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import pytest
import rclpy
from hypothesis import given
from hypothesis import strategies as st

from waam_node.node import WaamNode
from waam_node.params import ParameterError, from_dict, hint, markdown, param
from waam_node.testing import fresh_domain


@dataclass(frozen=True)
class Example:
    """Parameters for these tests."""

    cell: float = param(0.5e-3, 'edge of a cell', 'm', 1e-4, 5e-3)
    depth: int = param(10, 'queue', '', 1)
    law: str = param('zero', 'which law', choices=('zero', 'proportional'), gone={'old': 'zero'})
    offset: tuple = param((0.0, 0.0), 'offset', 'm')
    on: bool = param(True, 'switch')


def test_defaults():
    assert from_dict(Example, {}) == Example()


def test_unknown_parameter_is_named_with_a_hint():
    with pytest.raises(
        ParameterError, match="fusion: unknown parameter 'cel'; did you mean 'cell'"
    ):
        from_dict(Example, {'cel': 1.0}, 'fusion')


@pytest.mark.parametrize('name', ['in_layer', 'in_layer_gain', 'in_process_gate', 'arclight_glare'])
def test_a_parameter_that_is_gone_is_named_with_what_to_do(name):
    with pytest.raises(ParameterError) as e:
        from_dict(Example, {name: 1.0}, 'fusion')
    text = str(e.value)
    assert text.startswith(f"fusion: unknown parameter '{name}'; it is gone")
    assert 'leave it out' in text and 'upgrading.md' in text and 'did you mean' not in text


def test_a_name_that_is_only_like_one_that_is_gone_gets_a_hint():
    assert hint('min_layer', ['in_layer']) == "; did you mean 'in_layer'?"
    assert hint('queue', ['cell', 'law']) == '; known are cell, law'


@pytest.mark.parametrize(
    'name,value,word',
    [
        ('cell', 1.0, 'above its limit 0.005 m'),
        ('cell', 1e-6, 'below its limit 0.0001 m'),
        ('cell', math.nan, 'not a number'),
        ('cell', 'wide', 'type float'),
        ('depth', 0, 'below'),
        ('depth', 1.5, 'type int'),
        ('depth', True, 'type int'),
        ('law', 'magic', 'zero, proportional'),
        ('law', 'old', "'old' is gone, write 'zero'"),
        ('on', 1, 'type bool'),
    ],
)
def test_bad_value_is_named(name, value, word):
    with pytest.raises(ParameterError, match=word) as e:
        from_dict(Example, {name: value})
    assert name in str(e.value)


def test_int_is_taken_for_float_and_list_for_tuple():
    got = from_dict(Example, {'offset': [1.0, 2.0], 'use_sim_time': True})
    assert got.offset == (1.0, 2.0)
    with pytest.raises(ParameterError):
        from_dict(Example, {'cell': 1})  # 1 m is out of range, but an int as such is fine


@given(st.floats(1e-4, 5e-3))
def test_values_inside_the_limits_pass_unchanged(value):
    assert from_dict(Example, {'cell': value}).cell == value


def test_markdown_has_every_parameter_with_unit_and_limits():
    table = markdown(Example)
    for f in fields(Example):
        assert f'`{f.name}`' in table
    assert '0.0001 … 0.005' in table and 'zero, proportional' in table


@dataclass(frozen=True)
class Ranges:
    """Parameters with and without limits."""

    both: float = param(0.5, 'an edge', 'm', 0, 1.0)
    low: int = param(3, 'a depth', '', 1)
    high: float = param(0.5, 'a limit', '', None, 2.0)
    unknown: float = param(math.nan, 'as in the controller', '', 0.0, 1.0)
    free: float = param(0.5, 'anything')
    on: bool = param(True, 'a switch')


def test_limits_are_ranges_in_the_descriptors():
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=fresh_domain())
    node = WaamNode('ranges', Ranges, context=context)
    try:
        told = {f.name: node.describe_parameter(f.name) for f in fields(Ranges)}
        reals = {
            n: [(r.from_value, r.to_value) for r in d.floating_point_range] for n, d in told.items()
        }
        whole = {n: [(r.from_value, r.to_value) for r in d.integer_range] for n, d in told.items()}
        assert {n: r for n, r in reals.items() if r} == {
            'both': [(0.0, 1.0)],
            'high': [(-math.inf, 2.0)],
        }
        assert {n: r for n, r in whole.items() if r} == {'low': [(1, 2**63 - 1)]}
        assert told['both'].description == 'an edge [m]'
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
