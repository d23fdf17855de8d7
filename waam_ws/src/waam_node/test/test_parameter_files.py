"""A parameter file whose values a node would never see is refused; what rcl takes is taken. Compared with rcl."""

from __future__ import annotations

from pathlib import Path

import pytest
import rclpy
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rclpy.node import Node

from waam_node.parameter_files import check, files_in, matches
from waam_node.params import ParameterError

PARTS = st.sampled_from(['cell', 'bridge', 'a1', '*', '**'])


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])  # fmt: skip
@given(
    st.lists(PARTS, min_size=1, max_size=3), st.lists(st.sampled_from(['cell', 'a1']), max_size=2)
)
def test_blocks_are_matched_as_rcl_does(tmp_path, key, space):
    name, whole = '/'.join(['', *space, 'bridge']), '/' + '/'.join(key)
    file = tmp_path / 'p.yaml'
    file.write_text(f"'{whole}':\n  ros__parameters:\n    x: 1\n")
    context = rclpy.Context()
    rclpy.init(args=['--ros-args', '--params-file', str(file)], context=context)
    try:
        node = Node('bridge', namespace='/' + '/'.join(space), context=context)
        taken = 'x' in node._parameter_overrides
        node.destroy_node()
    finally:
        rclpy.shutdown(context=context)
    assert matches(whole, name) is taken


@pytest.mark.parametrize(
    'text,words',
    [
        ('bridge: {ros__parameters: {x: 1}}', "'bridge' is not for the node /cell2/bridge: write '/\\*\\*/bridge'"),
        ('/cell1/bridge: {ros__parameters: {x: 1}}', "'/cell1/bridge' is not for"),
        ('cell1: {bridge: {ros__parameters: {x: 1}}}', "'cell1/bridge' is not for"),
        ('recorder: {ros__parameters: {x: 1}}', 'has a block for the node /cell2/bridge: recorder'),
    ],
)  # fmt: skip
def test_a_file_that_would_be_passed_over_is_refused(tmp_path, text, words):
    file = tmp_path / 'p.yaml'
    file.write_text(text)
    with pytest.raises(ParameterError, match=words):
        check([file], '/cell2/bridge')


@pytest.mark.parametrize(
    'text',
    [
        '/**: {ros__parameters: {x: 1}}',
        "'/**/bridge': {ros__parameters: {x: 1}}\nrecorder: {ros__parameters: {x: 1}}",
        '/cell2/bridge: {ros__parameters: {x: 1}}',
        'cell2: {bridge: {ros__parameters: {x: 1}}}',
        '',
        'a: [',
    ],
)
def test_what_rcl_takes_or_refuses_itself_is_left_to_it(tmp_path, text):
    file = tmp_path / 'p.yaml'
    file.write_text(text)
    check([file, tmp_path / 'not_there.yaml'], '/cell2/bridge')


def test_one_of_several_files_is_enough(tmp_path):
    mine, other = tmp_path / 'a.yaml', tmp_path / 'b.yaml'
    mine.write_text("'/**/bridge': {ros__parameters: {x: 1}}")
    other.write_text('recorder: {ros__parameters: {x: 1}}')
    check([mine, other], '/bridge')
    check([other, mine], '/bridge')
    other.write_text('bridge: {ros__parameters: {x: 1}}')
    with pytest.raises(ParameterError, match='b.yaml'):
        check([mine, other], '/cell2/bridge')


@given(st.lists(st.sampled_from(['--ros-args', '--params-file', '--', 'a.yaml', '-p', 'x:=1'])))
def test_any_command_line_is_read(words):
    assert all(f in map(Path, words) for f in files_in(words))


def test_files_are_found_behind_ros_args():
    line = 'node --params-file no.yaml --ros-args -r __ns:=/c --params-file a.yaml --params-file b.yaml'
    assert files_in(line.split()) == [Path('a.yaml'), Path('b.yaml')]
