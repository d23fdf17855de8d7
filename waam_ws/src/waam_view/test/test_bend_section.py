"""What the report of a robot's job tells about the bend of its last map."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from waam_view.bend_section import bend_section
from waam_view.job_data import Job, Scan

BRIDGE = {
    'joint_offset': 3.5e-4, 'gear_wave': 9e-5, 'link_length': 1e-4, 'positioner': [1.2, 0.35, 0.15],
    'origin': [-0.2, -0.15, 0.0], 'work_low': [0.0, 0.0, 0.0], 'work_high': [0.4, 0.3, 0.2], 'tilt': 0.0, 'urdf': '',
}  # fmt: skip


def job(nodes: dict, worn: slice = slice(40, 80)) -> Job:
    """A plate of 60 x 60 mm, 0.1 mm high and a little aslant, the middle restored."""
    x, y = np.meshgrid(np.arange(120) * 5e-4, np.arange(120) * 5e-4)
    nominal, region = np.zeros(x.shape), np.zeros(x.shape)
    region[worn, worn] = 1.0
    z = 1e-4 + 1e-3 * x + np.random.default_rng(1).normal(0, 2e-5, x.shape)
    scan = Scan(3, (0.0, 0.0), 5e-4, {'z': z, 'nominal': nominal, 'region': region})
    asked = {'parameters': {'work_offset': [0.1, 0.08, 0.02]}, 'nodes': nodes}
    return Job(Path(), 'closed_loop', {}, {}, [scan], asked=asked)


def test_bend_height_and_slope_are_told():
    said = bend_section(job({'bridge': BRIDGE}))
    assert (
        'pose errors bend the measured map by 0.0' in said
        and 'cells of the surface that is known' in said
    )
    assert '(1.00 mm per m)' in said or '(0.99 mm per m)' in said or '(1.01 mm per m)' in said
    assert 'the map is off by 0.13' in said  # 0.1 mm, and 1 mm per m at the middle


def test_a_map_without_a_known_surface_says_so():
    said = bend_section(job({'bridge': BRIDGE}, slice(0, 120)))
    assert 'not estimated: the true surface is known in 0 cells' in said


def test_another_arm_and_a_gantry():
    assert 'not an arm from a URDF' in bend_section(job({'bridge': {**BRIDGE, 'urdf': 'a.urdf'}}))
    assert bend_section(job({'bridge': {'port': '/dev/ttyACM0'}})) == ''


def test_how_the_positioner_held_the_part_is_told():
    assert 'held the part still and level' in bend_section(job({'bridge': BRIDGE}))
    turned = bend_section(job({'bridge': {**BRIDGE, 'turning': [0.3, 1.5, -2.0]}}))
    assert 'by 17 deg, and 0.086 deg per mm of x, -0.115 deg per mm of y' in turned
    assert 'tilted by 80.2 deg' in bend_section(job({'bridge': {**BRIDGE, 'tilt': 1.4}}))
