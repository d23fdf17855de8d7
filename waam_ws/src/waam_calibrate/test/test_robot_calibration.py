"""Tool and scanner of a robot: found within the stated intervals on simulated robots, refused on poor evidence."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest
import robot_references as references
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_calibrate import cli, robot_evidence, robot_fit, store
from waam_calibrate.evidence import EvidenceError
from waam_calibrate.graph import Graph
from waam_calibrate.robot_evidence import Robot
from waam_robot.arm import M20IB25, forward
from waam_robot.frames import wpr
from waam_robot.station import Station
from waam_robot.uncertain import Stated, UncertainArm, turns
from waam_sim.robot import RobotParams

NOMINAL = Station().on_flange(references.NOMINAL)


def lines(made: references.Made) -> list[str]:
    return made.text.splitlines()


def tool(text: str, robot: Robot = Robot()) -> robot_fit.Tool:  # noqa: B008
    return robot_fit.tool(robot_evidence.touches(text, robot))


def test_intervals_of_the_tip_hold_the_truth() -> None:
    inside, off = [], []
    for seed in range(1, 9):
        made = references.touches(seed)
        found = tool(made.text)
        miss = found.tip - made.truth[:3, 3]
        inside += list(np.abs(miss) < found.interval)
        off.append(np.linalg.norm(miss))
        assert np.linalg.norm(found.tip - M20IB25.tool[:3, 3]) > 2 * np.median(off) or seed > 1
    assert sum(inside) >= 21  # of 24; 95 % are 22.8
    assert np.median(off) < 0.4e-3


def test_intervals_of_the_scanner_hold_the_truth() -> None:
    for seed in (3, 5):
        made = references.profiles(seed)
        seen = robot_evidence.profiles(made.text, Robot())
        found = robot_fit.hand_eye(seen, references.RADIUS, NOMINAL)
        off = found.scanner[:3, 3] - made.truth[:3, 3]
        assert np.linalg.norm(off) < 0.6e-3 < np.linalg.norm(NOMINAL[:3, 3] - made.truth[:3, 3])
        assert (np.abs(off) < 1.6 * found.interval[:3]).all()
        turned = found.scanner[:3, :3] @ made.truth[:3, :3].T
        assert np.arccos((np.trace(turned) - 1) / 2) < 1.6 * np.linalg.norm(found.interval[3:])


def test_larger_stated_errors_widen_the_interval() -> None:
    made = references.touches(2)
    usual, rough = tool(made.text), tool(made.text, Robot(stated=Stated(offset=8e-4, length=4e-4)))
    assert (rough.interval > 1.3 * usual.interval).all()


def test_poses_of_any_robot_instead_of_joints() -> None:
    made = references.touches(4, params=RobotParams(0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    joints = np.radians([[float(v) for v in line.split(',')] for line in lines(made)[1:]])
    flange = forward(M20IB25, joints, tool=False)
    rows = np.column_stack([flange[:, :3, 3] * 1e3, np.degrees(wpr(flange))])
    text = 'x y z w p r\n' + '\n'.join(' '.join(f'{v:.4f}' for v in row) for row in rows)
    found = tool(text)
    assert np.linalg.norm(found.tip - made.truth[:3, 3]) < 0.4e-3
    assert tool(text.replace('x y z w p r', 'X;Y;Z;W;P;R')).tip == pytest.approx(found.tip)


def test_errors_of_an_arm_are_its_derivatives() -> None:
    theta = np.radians([[10, 60, -20, 5, 40, 10], [-10, 70, -30, 15, 50, 30]])
    arm = UncertainArm(M20IB25, theta)
    one = np.zeros(len(arm.sigma))
    one[1] = 1e-3  # offset of joint 2
    moved = theta + [0, 1e-3, 0, 0, 0, 0]
    assert np.abs(arm.poses(one) - forward(M20IB25, moved, tool=False)).max() < 1e-12
    still = np.abs(arm.poses(0 * one) - forward(M20IB25, theta, tool=False)).max()
    assert still < 1e-12 and len(arm.sigma) == 6 + 24 + 6 + 12
    v = np.array([0.3, -0.2, 0.5])
    assert turns(v) @ v == pytest.approx(v) and np.linalg.det(turns(v)) == pytest.approx(1.0)


def test_poor_touches_are_refused_with_the_reason() -> None:
    made = lines(references.touches(1))
    with pytest.raises(EvidenceError, match='3 touches, at least 4'):
        tool('\n'.join(made[:4]))
    with pytest.raises(EvidenceError, match='about one axis'):
        spun = [made[1].rsplit(',', 1)[0] + f',{a}' for a in (0, 20, 40, 60, 80)]
        tool('\n'.join([made[0], *spun]))
    wrong = [float(v) for v in made[4].split(',')]
    wrong[1] += 1.0
    with pytest.raises(EvidenceError, match='contradict .* pose 4'):
        tool('\n'.join([*made[:4], ','.join(map(str, wrong)), *made[5:]]))


def test_poor_profiles_are_refused_with_the_reason() -> None:
    made = references.profiles(1)
    few = [line for line in lines(made)[1:] if int(line.split(',')[0]) < 6]
    for text, said in (
        ('\n'.join([lines(made)[0], *few]), '5 poses, at least 6'),
        ('\n'.join([*lines(made)[:40], lines(made)[-1]]), 'poses, at least 6'),
        (made.text.replace('\n1,', '\n2,', 1), 'pose 2 has more than one place'),
    ):
        with pytest.raises(EvidenceError, match=said):
            robot_fit.hand_eye(robot_evidence.profiles(text, Robot()), 15e-3, NOMINAL)
    seen = robot_evidence.profiles(made.text, Robot())
    with pytest.raises(EvidenceError, match='2 to 200 mm'):
        robot_fit.hand_eye(seen, 0.5, NOMINAL)
    with pytest.raises(EvidenceError):  # a sphere of another size
        robot_fit.hand_eye(seen, 11e-3, NOMINAL)


@settings(max_examples=60, deadline=None)
@given(st.text(alphabet='j123456xyzwpr ,;.-e#\nnaif', max_size=200))
def test_any_text_is_read_or_refused(text: str) -> None:
    for read in (robot_evidence.touches, robot_evidence.profiles):
        try:
            read(text, Robot())
        except EvidenceError as e:
            assert str(e)


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('', 'empty'),
        ('a b c', 'line 1: the columns must be'),
        ('# touches\nj1 j2 j3 j4 j5 j6\n1 2 3', 'line 3: 3 values for 6 columns'),
        ('j1 j2 j3 j4 j5 j6\n1 2 3 4 five 6', 'line 2, column j5'),
        ('j1 j2 j3 j4 j5 j6\n1 2 3 4 nan 6', 'line 2, column j5'),
    ],
)
def test_errors_name_line_and_column(text: str, said: str) -> None:
    with pytest.raises(EvidenceError, match=said):
        robot_evidence.touches(text, Robot())


def test_results_are_kept_shown_and_refuse_a_job(tmp_path: Path, capsys) -> None:
    def unused(*_: object) -> None:
        raise AssertionError('no graph here')

    graph = Graph(
        folder=lambda: tmp_path, add_options=lambda p: None, measure=unused, send=unused,
        told=lambda args: None, wire=unused,
    )  # fmt: skip
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers(), graph)

    def waam(line: str) -> int:
        args = parser.parse_args(['calibrate', *line.split()])
        return int(args.run_command(args))

    for what in ('touches', 'profiles'):
        (tmp_path / f'{what}.csv').write_text(getattr(references, what)(3).text)
    assert waam(f'robot-tcp --file {tmp_path}/touches.csv --told 287.9 1.0 90') == 0
    assert waam(f'hand-eye --file {tmp_path}/profiles.csv') == 0
    (tmp_path / 'wrong.csv').write_text('a b c')
    with pytest.raises(ValueError, match=r'wrong\.csv: line 1: the columns must be'):
        waam(f'robot-tcp --file {tmp_path}/wrong.csv')
    kept = {r.kind: r for r in store.load_all(tmp_path).results}
    assert kept['robot-tcp'].refuses == '' and 'mount_xyz' in kept['hand-eye'].refuses
    assert 'data:image/png' in next(tmp_path.glob('robot-tcp_*.html')).read_text()
    capsys.readouterr()
    assert waam('status') == 1
    said = capsys.readouterr().out
    assert 'tip at 287.' in said and 'hand-eye     2' in said
