"""A tilted part through planner, job, cell and robot: every one of them at the same tilt, or a clear refusal."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from waam_lab import restore, run
from waam_lab.robot.dry_run import work_zero
from waam_lab.robot.robot_check import check
from waam_plan import cli
from waam_plan.layers.restore import plan_restoration
from waam_plan.mesh.inputs import of_part
from waam_plan.mesh.part import load_part
from waam_plan.plan import Plan
from waam_plan.settings import PlanSettings
from waam_robot_bridge.params import RobotParams
from waam_sim import part as parts

TILT = math.pi / 2


@pytest.fixture(scope='module')
def files(tmp_path_factory) -> tuple[Path, Path]:
    """A post of 12 x 40 x 50 mm, and with a level arm of 4 mm off its side."""
    folder = tmp_path_factory.mktemp('tilt')
    post = trimesh.creation.box(bounds=[[0, 0, 0], [12, 40, 50]])
    arm = trimesh.creation.box(bounds=[[6, 0, 20], [16, 40, 32]])
    whole = trimesh.util.concatenate([post, arm])
    whole.export(folder / 'arm.stl')
    post.export(folder / 'post.stl')
    return folder / 'arm.stl', folder / 'post.stl'


def planned(files: tuple[Path, Path], clamp: bool = True) -> Plan:
    settings = PlanSettings(tilt_deg=90.0, clamp=clamp)
    surfaces = of_part(load_part(files[0]), files[1], 1e-3, settings, False)
    return plan_restoration(surfaces.found, surfaces.nominal, settings)


def test_the_side_of_the_post_is_the_ground_of_the_arm(files):
    plan = planned(files)
    region = plan.layers[0].footprint
    assert plan.as_found.z[region] == pytest.approx(12e-3, abs=1e-4)
    assert plan.layers[-1].target_after[region].max() == pytest.approx(16e-3, abs=1e-4)
    x = plan.spec.x[region.any(axis=0)]  # z 20 to 32 of the part, counted from its top at 50
    assert x.min() == pytest.approx(18e-3, abs=1.2e-3) and x.max() == pytest.approx(30e-3, abs=2e-3)


def test_the_cell_shows_the_same_surface(files):
    plan = planned(files)
    table = parts.from_stl(str(files[1]), plan.spec.resolution, 5e-3, TILT)
    seen = np.isfinite(plan.as_found.z)
    assert table.z.max() == pytest.approx(np.nanmax(plan.as_found.z), abs=1e-6)
    assert (table.z > 1e-3).sum() == pytest.approx((plan.as_found.z[seen] > 1e-3).sum(), rel=0.03)


def test_the_robot_takes_the_plan_at_its_tilt_only(files):
    plan = planned(files)
    assert 'tilt of 90 deg, the positioner stands at 0' in check(plan, RobotParams()).refused
    found = check(plan, RobotParams(tilt=TILT))
    assert found.refused == '' and found.contacts == ()


def test_on_the_faceplate_the_zero_goes_with_the_part(files):
    from waam_robot.station import Station

    station = Station(RobotParams(tilt=TILT).place())
    held, stands = (work_zero(planned(files, clamp), station) for clamp in (True, False))
    assert held == (0.1, 0.08, 0.02) and np.abs(np.subtract(held, stands)).max() > 0.05


def test_a_job_is_refused_where_bridge_or_cell_stand_otherwise(files):
    setting = ('tilt_deg=90', 'clamp=true')
    level = run(restore(*files, 1, machine='robot', plan_settings=setting))
    assert level.failed and 'tilted by 90 deg' in level.message and 'at 0 deg' in level.message
    with pytest.raises(ValueError, match='both are the tilt of one positioner'):
        run(restore(*files, 1, machine='robot', overrides={'robot_bridge': {'tilt': TILT}}))


@pytest.mark.parametrize(
    ('line', 'said'),
    [
        ('--as-found {1} --tilt 90', 'needs --machine robot'),
        ('--machine robot --tilt 90', 'no level ground'),
        ('--as-found {1} --machine robot --tilt 120', 'tilt_deg is 120, must be between'),
        ('--as-found {1} --machine robot --clamp', 'clamp belongs to a tilt'),
    ],
)
def test_the_command_says_what_is_missing(files, capsys, line, said):
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers())
    args = parser.parse_args(['plan', str(files[0]), *line.format(*files).split()])
    assert args.run_command(args) == 2
    assert said in capsys.readouterr().err
