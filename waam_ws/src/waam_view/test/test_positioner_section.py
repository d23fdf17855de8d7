"""What the report of a robot's job tells about its positioner."""

from __future__ import annotations

from pathlib import Path

from waam_view.job_data import Job
from waam_view.positioner_section import positioner_section

BRIDGE = {'positioner': [1.2, 0.35, 0.15], 'tilt': 0.0, 'urdf': ''}


def said(bridge: dict) -> str:
    return positioner_section(
        Job(Path(), 'closed_loop', {}, {}, [], asked={'nodes': {'bridge': bridge}})
    )


def test_how_the_positioner_held_the_part_is_told():
    assert 'held the part still and level' in said(BRIDGE)
    turned = said({**BRIDGE, 'turning': [0.3, 1.5, -2.0]})
    assert 'by 17 deg, and 0.086 deg per mm of x, -0.115 deg per mm of y' in turned
    assert 'tilted by 80.2 deg' in said({**BRIDGE, 'tilt': 1.4})


def test_a_gantry_has_none():
    assert said({'port': '/dev/ttyACM0'}) == ''
