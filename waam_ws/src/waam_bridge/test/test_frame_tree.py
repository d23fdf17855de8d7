"""The tree of frames: a URDF and positions in, transforms out."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from ament_index_python import get_package_share_directory
from hypothesis import given
from hypothesis import strategies as st

from waam_bridge.frame_tree import (
    AXES,
    STANDOFF,
    TORCH,
    WORK,
    Placed,
    Tree,
    gantry_urdf,
    in_root,
    matrix,
    quaternion,
    work_frames,
)
from waam_bridge.params import BridgeParams
from waam_bridge.standoff import Standoff

LOW, HIGH = (0.0, 0.0, 0.0), (0.4, 0.3, 0.2)
ZERO = (0.1, 0.08, 0.02)
lengths = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


def placed(at, standoff=0.1):
    tree = Tree(gantry_urdf(LOW, HIGH, 0.5))
    return [*tree.at(dict(zip(AXES, at, strict=True))), *work_frames(ZERO, standoff)]


def test_one_root_and_every_frame_once():
    found = placed((0.2, 0.1, 0.1))
    children = [p.child for p in found]
    assert len(children) == len(set(children))
    assert {p.parent for p in found} - set(children) == {'machine'}
    assert all(np.isfinite(in_root(found, name)).all() for name in children)


@given(lengths)
def test_the_torch_is_seen_from_work_where_telemetry_has_it(at):
    found = placed(at)
    seen = np.linalg.inv(in_root(found, WORK)) @ in_root(found, TORCH)
    assert seen[:3, 3] == pytest.approx(np.subtract(at, ZERO), abs=1e-12)
    assert seen[:3, :3] == pytest.approx(np.eye(3), abs=1e-12)


def test_the_distance_sensor_looks_at_the_metal_under_the_wire():
    found = placed((0.2, 0.1, 0.1), standoff=0.1)
    looks = in_root(found, STANDOFF)
    assert looks @ [0.1, 0, 0, 1] == pytest.approx([0.2, 0.1, 0.1, 1])
    assert STANDOFF not in {p.child for p in placed((0, 0, 0), standoff=0.0)}
    assert Standoff(BridgeParams(standoff_source='laser')).distance == pytest.approx(0.1)
    assert Standoff(BridgeParams(standoff_source='arc')).distance == 0.0


@given(lengths.map(lambda v: tuple(math.pi * x for x in v)))
def test_roll_pitch_and_yaw_turn_about_fixed_axes(rpy):
    def about(axis, angle):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        out = np.eye(3)
        out[a, a] = out[b, b] = math.cos(angle)
        out[a, b], out[b, a] = -math.sin(angle), math.sin(angle)
        return out

    wanted = about(2, rpy[2]) @ about(1, rpy[1]) @ about(0, rpy[0])
    found = matrix(Placed('a', 'b', (0, 0, 0), quaternion(rpy)))
    assert found[:3, :3] == pytest.approx(wanted, abs=1e-12)


def test_frames_that_go_round_are_named():
    with pytest.raises(ValueError, match="round through 'a'"):
        in_root([Placed('a', 'b', (0, 0, 0)), Placed('b', 'a', (0, 0, 0))], 'a')


def test_the_message_is_the_released_one_on_the_wire():
    """The type hash of tf2_msgs 0.36, as `ros2 topic info --verbose /tf` of Jazzy tells it."""
    file = Path(get_package_share_directory('tf2_msgs')) / 'msg' / 'TFMessage.json'
    hashes = {h['type_name']: h['hash_string'] for h in json.loads(file.read_text())['type_hashes']}
    wanted = 'RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087'
    assert hashes['tf2_msgs/msg/TFMessage'] == wanted
