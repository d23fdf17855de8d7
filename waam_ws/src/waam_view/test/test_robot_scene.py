"""Arm and positioner in the viewer: where the joints have them, with the part in the same frame, and in the file."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from scipy.spatial.transform import Rotation

from waam_robot.bodies import PART, TOOL, bodies_of, ends, frames_of
from waam_robot.station import Place, Station
from waam_robot.turning import Turning
from waam_robot.urdf_station import UrdfPlace, UrdfStation
from waam_view import blueprint as bp
from waam_view.robot_scene import RobotScene, entity_of, shapes
from waam_view.scene import Scene

sys.path.insert(0, str(Path(__file__).parent))
from test_drawing import entities  # noqa: E402

NAMES = ('joint_1', 'joint_2', 'joint_3', 'joint_4', 'joint_5', 'joint_6', 'tilt', 'turn')
ZERO = (0.1, 0.08, 0.02)
START = 1_800_000_000 * 10**9
PLACES = ((1.2, 0.35, 0.15), (-0.2, -0.15, 0.0))


@pytest.fixture(scope='module')
def station():
    return Station()


def known(station: Station, tip: tuple[float, float, float]) -> dict[str, float]:
    joints = station.joints(np.array([tip]) + ZERO)[0]
    return dict(zip(NAMES, joints.tolist(), strict=True))


class Log:
    """What was drawn: entity -> transforms (4, 4) and what stays."""

    def __init__(self) -> None:
        self.kept: dict[str, rr.AsComponents] = {}
        self.frames: dict[str, np.ndarray] = {}
        self.eyes: list[bp.Eyes] = []

    def keep(self, entity, what) -> None:
        self.kept[entity] = what

    def show_robot(self, eyes) -> None:
        self.eyes.append(eyes)

    def log(self, t, entity, what) -> None:
        pose = np.eye(4)
        pose[:3, 3] = what.translation.as_arrow_array().to_pylist()[0]
        pose[:3, :3] = np.reshape(what.mat3x3.as_arrow_array().to_pylist()[0], (3, 3)).T
        self.frames[entity] = pose


@pytest.mark.parametrize('tip', [(0.0, 0.0, 0.0), (0.12, 0.03, 0.08)])
def test_the_torch_is_where_the_work_frame_has_it(station, tip):
    log = Log()
    RobotScene(NAMES, *PLACES).draw(log, START, known(station, tip), ZERO)
    torch = log.frames[bp.ROBOT] @ log.frames[f'{bp.ROBOT}/torch']
    assert torch[:3, 3] == pytest.approx(tip, abs=1e-6)
    assert torch[:3, 2] == pytest.approx((0, 0, -1), abs=1e-6)
    plate = log.frames[bp.ROBOT] @ log.frames[f'{bp.ROBOT}/faceplate']
    assert plate[2, 3] == pytest.approx(-ZERO[2], abs=1e-6)  # machine zero lies on it


def test_a_tilted_positioner_is_drawn_tilted(station):
    log, scene = Log(), RobotScene(NAMES, *PLACES)
    scene.draw(log, START, known(station, (0, 0, 0)), ZERO)
    scene.draw(log, START, known(station, (0.01, 0, 0)), ZERO)
    assert len(log.eyes) == 1
    tilted = Station(Place(tilt=1.2))
    scene.draw(log, START, known(tilted, (0.02, 0.0, 0.01)), ZERO)
    plate = log.frames[bp.ROBOT] @ log.frames[f'{bp.ROBOT}/faceplate']
    assert np.arccos(plate[2, 2]) == pytest.approx(1.2, abs=1e-6)
    torch = log.frames[bp.ROBOT] @ log.frames[f'{bp.ROBOT}/torch']
    assert torch[:3, 3] == pytest.approx((0.02, 0.0, 0.01), abs=1e-6)
    assert len(log.eyes) == 1


def test_a_joint_that_nobody_tells_is_named(station):
    joints = known(station, (0, 0, 0))
    scene = RobotScene(NAMES, *PLACES)
    assert scene.missing(joints) == ''
    del joints['turn']
    assert scene.missing(joints) == 'turn'


def test_a_file_that_begins_later_has_the_whole_robot(station, tmp_path):
    scene, robot = Scene(6e-4), RobotScene(NAMES, *PLACES)
    robot.draw(scene, START, known(station, (0, 0, 0)), ZERO)
    (tmp_path / 'job').mkdir()
    scene.record(tmp_path / 'job/job.rrd')
    robot.draw(scene, START + 10**9, known(station, (0.05, 0, 0)), ZERO)
    scene.remove('file')
    found = entities(tmp_path / 'job/job.rrd')
    wanted = {
        bp.ROBOT,
        f'{bp.ROBOT}/torch/body',
        f'{bp.ROBOT}/link_3/body',
        f'{bp.ROBOT}/positioner/body_0',
    }
    assert wanted | {entity_of(n) for n in range(10)} <= found


def hidden(eye: bp.Eye, points: np.ndarray, capsules: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """(N,) which of points (N, 3) lie behind one of the capsules with ends (K, 2, 3)."""
    ways = eye.position + np.linspace(0, 1, 300)[:, None, None] * (points - eye.position)
    out = np.zeros(len(points), bool)
    for (a, b), radius in zip(capsules, radii, strict=True):
        share = np.clip((ways - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)[..., None]
        out |= (np.linalg.norm(ways - a - share * (b - a), axis=2) < radius).any(axis=0)
    return out


@pytest.mark.parametrize(
    'where', [{}, {'tilt': 1.2}, {'turning': Turning(1.0)}, {'turning': Turning(-1.2)}]
)
def test_the_arm_does_not_hide_the_part(where):
    """A box of 60 x 30 x 12 mm below the torch, wherever that is; arm and positioner are in the picture with it."""
    station = Station(Place(**where))
    arm, positioner = station.place.arm, station.place.positioner
    bodies, log = bodies_of(arm, positioner), Log()
    radii = np.array([c.radius for c in bodies.capsules])
    scene = RobotScene(NAMES, *PLACES)
    scene.draw(log, START, known(station, (0.0, 0.0, 0.1)), ZERO)
    (eyes,) = log.eyes
    box = np.mgrid[-0.03:0.031:0.03, -0.015:0.016:0.015, -0.014:-0.001:0.006].reshape(3, -1).T
    shares = []
    for tip in np.mgrid[0.02:0.39:0.09, 0.02:0.29:0.13, 0.03:0.1:0.06].reshape(3, -1).T:
        frames = frames_of(arm, positioner, station.joints(tip[None]))
        (capsules,) = ends(bodies.capsules, frames)
        tool, turn = frames[0, TOOL, :3, 3], frames[0, PART, :3, :3]
        part = tool + box @ turn.T
        shares.append([hidden(eye, part, capsules, radii).mean() for eye in eyes])
        middle = np.subtract(eyes[0].target, eyes[0].position)
        seen = np.concatenate([capsules.reshape(-1, 3), part, frames[0, [PART], :3, 3]])
        ways = seen - eyes[0].position
        off = ways @ middle / np.linalg.norm(ways, axis=1) / np.linalg.norm(middle)
        assert np.degrees(np.arccos(off)).max() < 27.5  # half of what the viewer shows
    cell, near = np.array(shares).T
    assert cell.mean() < 0.1 and cell.max() < 0.35
    assert near.mean() < 0.2  # the torch itself stands before some of it


def test_capsules_lie_along_their_lines():
    """The viewer draws them from (0, 0, 0) to (0, 0, length), turned and moved."""
    place = Station().place
    bodies = bodies_of(place.arm, place.positioner)
    drawn = shapes(bodies)
    for entity in (f'{bp.ROBOT}/link_2/body', f'{bp.ROBOT}/link_4/body', f'{bp.ROBOT}/torch/body'):
        own = [c for c in bodies.capsules if entity_of(c.frame) == entity.rsplit('/', 1)[0]]
        shape = drawn[entity]
        turns, starts, lengths = (
            np.array(v.as_arrow_array().to_pylist())
            for v in (shape.quaternions, shape.translations, shape.lengths)
        )
        ends = starts + Rotation.from_quat(turns).apply([0, 0, 1]) * lengths[:, None]
        assert starts == pytest.approx(np.array([c.a for c in own]), abs=1e-6)
        assert ends == pytest.approx(np.array([c.b for c in own]), abs=1e-6)


def test_an_arm_from_a_urdf_is_drawn_where_its_joints_have_it():
    pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')
    names = ('base', 'shoulder', 'elbow', 'wrist_roll', 'wrist_bend', 'wrist_turn')
    posture = (0.0, 0.46, 0.40, 0.0, 1.09, 3.14)
    text = (Path(__file__).parents[2] / 'waam_sim' / 'urdf' / 'small_arm.urdf').read_bytes()
    origin = (-0.2, -0.15, 0.0)
    station = UrdfStation(text, UrdfPlace(names, origin, posture=posture))
    joints = station.joints(np.array([[0.12, 0.1, 0.05]]))[0]
    log = Log()
    scene = RobotScene(names, PLACES[0], origin, text)
    scene.draw(log, START, dict(zip(names, joints.tolist(), strict=True)), ZERO)
    torch = log.frames[bp.ROBOT] @ log.frames[f'{bp.ROBOT}/torch']
    assert torch[:3, 3] == pytest.approx(np.subtract((0.12, 0.1, 0.05), ZERO), abs=1e-6)
    assert torch[:3, 2] == pytest.approx((0, 0, -1), abs=1e-6)
    assert f'{bp.ROBOT}/link_2/body' in log.kept and f'{bp.ROBOT}/link_0/block_1' in log.kept


def test_a_part_that_turns_is_drawn_turned():
    turned = Station(Place(turning=Turning(0.4, (1.0, 2.0))))
    log = Log()
    RobotScene(NAMES, *PLACES).draw(log, START, known(turned, (0.05, 0.02, 0.0)), ZERO)
    torch = log.frames[bp.ROBOT] @ log.frames[f'{bp.ROBOT}/torch']
    assert torch[:3, 3] == pytest.approx((0.05, 0.02, 0.0), abs=1e-6)
