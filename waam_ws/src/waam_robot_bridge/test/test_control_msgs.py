"""control_msgs is the stock package on the wire: type hashes, constants, and the bytes of a message packed by hand.

Stock: github.com/ros-controls/control_msgs, branch jazzy, releases 5.3.0 to 5.9.0, which do not differ here. The hashes
are what rosidl_generator_type_description 4.6 computes from their files.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path

import pytest
from ament_index_python import get_package_share_directory
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import (
    DynamicInterfaceGroupValues,
    InterfaceValue,
    JointComponentTolerance,
    JointTolerance,
)
from rclpy.context import Context
from rclpy.node import Node
from rclpy.serialization import serialize_message

from waam_node.testing import fresh_domain

ACTION = 'action/FollowJointTrajectory'
STOCK = {
    ACTION: '738ebcb7a2d7cfa42f9f1001cc99ce3a4383d1cfe508015d9be8485e4b1c66f6',
    f'{ACTION}_Feedback': '3fd0aaecf71725121ae1ff7f01098a5e0da581e672be18a6b2c286cb43d96b49',
    f'{ACTION}_FeedbackMessage': '80398fcb9674a79081a9906e2ccf0c804dd7cb15e22e362e606ee87186beab71',
    f'{ACTION}_GetResult': 'e3ceb38e3e1867c8dc0f46014df26e90eb93422f27e9e97f936e07f94be4bc8b',
    f'{ACTION}_GetResult_Event': '43161a489e52daaa5bbc2fa74f73f1804d099574fcf8f819170807d75472662a',
    f'{ACTION}_GetResult_Request': 'ecf7ea8463d3beec7084bca75216d0b01b87b6e1e4e09679bb26093041efcbe9',
    f'{ACTION}_GetResult_Response': '08eefbaa146ce02ba45898d5e99160afd6c4c54a30d159aee0f2ca6035b1580f',
    f'{ACTION}_Goal': '8a9060704b269608f5a340934cc26e66869dd14bdac29e2e7fd9ec8b9882d205',
    f'{ACTION}_Result': '8002e99ed2c14c6faa522f2a93c26d744c5982f254f9e98ff9c6f19789bdb220',
    f'{ACTION}_SendGoal': 'b13789dddc325a7a962825c45e28c77d37237ec129dd0c34dc5994562938c57f',
    f'{ACTION}_SendGoal_Event': '906dd566308db02673c73c654f69bdd84738589629c1bc2841ddb49059ed1c6f',
    f'{ACTION}_SendGoal_Request': '179c93691f1f6d1d115881ff88c3917b7cc6eac2ba4bf56766cc7c4389e19ef1',
    f'{ACTION}_SendGoal_Response': 'e6a48ba740ae254500129a877f0b071be8663a115da1a539b74599cc97921fbf',
    'msg/DynamicInterfaceGroupValues': '0ebef56c55cdde46b4622f7e0a4dbf26fefbf0296205463e955047252b434cbc',
    'msg/InterfaceValue': '74a12144ef6b7af67533195cb30f7f607d3301b66950208a72d280695f3e190c',
    'msg/JointComponentTolerance': '739ea7566931944d33830fa10f1bf5e7a7fbdc3172bce7a7eaac642bd6e3ffa4',
    'msg/JointTrajectoryControllerState': '51d8dd89cc624cbe9daaeeb4d80d6de9b86168ffdc3be41fefc0953e3c26e480',
    'msg/SpeedScalingFactor': '0c240f349f2b74e33e8741f83e0f196ddeb6585923663876ed3c1f51f0566037',
    'msg/JointTolerance': 'c254f9cece0f3b733017b6990fd46d1326e25242d6b8844398c97d9a88e7d648',
}
ERRORS = {
    'SUCCESSFUL': 0,
    'INVALID_GOAL': -1,
    'INVALID_JOINTS': -2,
    'OLD_HEADER_TIMESTAMP': -3,
    'PATH_TOLERANCE_VIOLATED': -4,
    'GOAL_TOLERANCE_VIOLATED': -5,
}
COMPONENTS = {'X_AXIS': 1, 'Y_AXIS': 2, 'Z_AXIS': 3, 'TRANSLATION': 4, 'ROTATION': 5}


@pytest.fixture(scope='module')
def built():
    """Hash of every type, as the workspace was built."""
    share = Path(get_package_share_directory('control_msgs'))
    found = {}
    for file in share.glob('*/*.json'):
        for entry in json.loads(file.read_text())['type_hashes']:
            found[entry['type_name']] = entry['hash_string']
    return {k.removeprefix('control_msgs/'): v for k, v in found.items() if 'control_msgs' in k}


@pytest.mark.parametrize('name', STOCK)
def test_types_are_those_of_the_stock_package(name, built):
    assert built[name] == f'RIHS01_{STOCK[name]}'


def test_every_type_is_compared(built):
    assert set(built) == set(STOCK)


def test_a_publisher_tells_the_stock_hash():
    """What is compiled, not what a file of the build says."""
    context = Context()
    context.init(domain_id=fresh_domain())
    node = Node('types', context=context)
    kinds = {
        'msg/DynamicInterfaceGroupValues': DynamicInterfaceGroupValues,
        'msg/JointTolerance': JointTolerance,
        f'{ACTION}_FeedbackMessage': FollowJointTrajectory.Impl.FeedbackMessage,
        f'{ACTION}_SendGoal_Request': FollowJointTrajectory.Impl.SendGoalService.Request,
        f'{ACTION}_GetResult_Response': FollowJointTrajectory.Impl.GetResultService.Response,
    }
    try:
        for n, (name, kind) in enumerate(kinds.items()):
            node.create_publisher(kind, f'topic_{n}', 1)
            (info,) = node.get_publishers_info_by_topic(f'topic_{n}')
            assert str(info.topic_type_hash) == f'RIHS01_{STOCK[name]}'
    finally:
        node.destroy_node()
        context.shutdown()


def test_constants_are_those_of_the_stock_package():
    """They are not in the hash."""
    for kind, wanted in (
        (FollowJointTrajectory.Result, ERRORS),
        (JointComponentTolerance, COMPONENTS),
    ):
        names = [n for n in dir(kind) if n.isupper() and n != 'SLOT_TYPES']
        assert {n: getattr(kind, n) for n in names} == wanted


class Cdr:
    """CDR, little endian: numbers at multiples of their size, strings and sequences behind their length."""

    def __init__(self) -> None:
        self.pieces: list[tuple[int, bytes]] = []  # what is between them may be anything
        self.end = 0

    def put(self, data: bytes, size: int = 1) -> Cdr:
        at = self.end + -self.end % size
        self.pieces.append((at, data))
        self.end = at + len(data)
        return self

    def number(self, kind: str, *values: float) -> Cdr:
        for value in values:
            self.put(struct.pack('<' + kind, value), struct.calcsize(kind))
        return self

    def text(self, *texts: str) -> Cdr:
        for text in texts:
            data = text.encode() + b'\0'
            self.number('I', len(data)).put(data)
        return self

    def same(self, message: object) -> bool:
        head, data = serialize_message(message)[:4], serialize_message(message)[4:]
        right = all(data[at : at + len(piece)] == piece for at, piece in self.pieces)
        return head[:2] == b'\0\1' and right and 0 <= len(data) - self.end < 4


def test_a_welding_message_has_the_bytes_of_the_stock_package():
    """header, interface_groups, interface_values of interface_names and values."""
    message = DynamicInterfaceGroupValues()
    message.header.stamp.sec, message.header.stamp.nanosec = 1_750_000_000, 123_456_789
    message.header.frame_id = 'cell'
    message.interface_groups = ['welding', 'io']
    message.interface_values = [
        InterfaceValue(interface_names=['arc', 'gas'], values=[1.0, 0.5]),
        InterfaceValue(interface_names=['lamp'], values=[-2.25]),
    ]
    wire = Cdr().number('i', 1_750_000_000).number('I', 123_456_789).text('cell')
    wire.number('I', 2).text('welding', 'io').number('I', 2)
    wire.number('I', 2).text('arc', 'gas').number('I', 2).number('d', 1.0, 0.5)
    wire.number('I', 1).text('lamp').number('I', 1).number('d', -2.25)
    assert wire.same(message)


def test_tolerances_have_the_bytes_of_the_stock_package():
    one = JointTolerance(name='joint_1', position=0.1, velocity=-1.0, acceleration=3.5)
    assert Cdr().text('joint_1').number('d', 0.1, -1.0, 3.5).same(one)
    other = JointComponentTolerance(
        joint_name='base',
        component=JointComponentTolerance.ROTATION,
        position=0.1,
        velocity=0.25,
        acceleration=7.5,
    )
    assert Cdr().text('base').number('H', 5).number('d', 0.1, 0.25, 7.5).same(other)


def test_a_result_has_the_bytes_of_the_stock_package():
    result = FollowJointTrajectory.Result(error_code=-4, error_string='late')
    assert Cdr().number('i', -4).text('late').same(result)
