"""The source's XML and point files: what is read is what was written; what is wrong is named with its line."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_robot.arm import M20IB25, ArmError, forward
from waam_robot.config_xml import (
    Chain,
    Frame,
    Segment,
    arm_of,
    chain_of,
    from_file,
    read,
    to_file,
    write,
)
from waam_robot.points import PointsError, pose_lines, read_angles, read_inverse
from waam_robot.xml_tree import XmlError, parse

# the part of the file that the source prints (figure 3.8)
PRINTED = """
<Segments>

  <Segment>
    <JointType>RotZ</JointType>
    <MinAngle>-3.14159265359</MinAngle>
    <MaxAngle>3.14159265359</MaxAngle>
    <Frame>
      <Alfa>0.0</Alfa>
      <Beta>0.0</Beta>
      <Gamma>0.0</Gamma>
    </Frame>
    <Frame>
      <X>75.0</X>
      <Y>0.0</Y>
      <Z>0.0</Z>
    </Frame>
  </Segment>

  <Segment>
    <JointType>RotY</JointType>
    <MinAngle>-1.57079632679</MinAngle>
    <MaxAngle>2.35619449019</MaxAngle>
    <Frame>
      <X>0.0</X>
      <Y>0.0</Y>
      <Z>905.0</Z>
    </Frame>
  </Segment>
</Segments>
"""
NUMBER = st.floats(-500, 500)
FRAMES = st.builds(Frame, st.tuples(*[st.floats(-7, 7)] * 3), st.tuples(*[NUMBER] * 3))
SEGMENTS = st.builds(
    Segment,
    st.sampled_from(['Fixed', 'RotX', 'RotY', 'RotZ']),
    st.floats(-9, -0.1),
    st.floats(0.1, 9),
    st.lists(FRAMES, max_size=3).map(tuple),
)
CHAINS = st.lists(SEGMENTS, min_size=1, max_size=8).map(lambda s: Chain(tuple(s)))


def test_the_printed_fragment():
    chain = read(PRINTED)
    assert [s.kind for s in chain.segments] == ['RotZ', 'RotY']
    assert chain.joints[1].low == pytest.approx(-np.pi / 2) and chain.joints[
        1
    ].high == pytest.approx(2.35619449)
    assert chain.forward(np.zeros(2))[:3, 3] == pytest.approx([0.075, 0, 0.905])
    assert chain.forward(np.array([0, np.pi / 2]))[:3, 3] == pytest.approx(
        [0.98, 0, 0]
    )  # J2 goes forwards


@given(st.tuples(*[st.floats(-3, 3)] * 6).map(np.array))
def test_the_arm_in_the_file_is_the_arm_of_the_table(theta):
    chain = read(write(chain_of(M20IB25)))
    pose = forward(M20IB25, theta)
    pose[2, 3] -= 0.650  # the file's world lies on the level of joint 2
    assert chain.forward(to_file(theta)) == pytest.approx(pose, abs=1e-9)
    assert forward(arm_of(chain), theta) == pytest.approx(pose, abs=1e-9)
    assert from_file(to_file(theta)) == pytest.approx(theta)


def test_limits_come_through_the_file():
    arm = arm_of(read(write(chain_of(M20IB25))))
    assert arm.low == pytest.approx(M20IB25.low) and arm.high == pytest.approx(M20IB25.high)
    chain = chain_of(M20IB25)
    assert chain.joints[1].low == pytest.approx(-np.pi / 2)
    assert chain.joints[1].high == pytest.approx(3 * np.pi / 4)  # as the source prints them
    assert (
        chain.beyond(np.array([4.0, 0, 0, 0, 0, 0]))
        == 'J1 = 4.0000 rad is outside -3.1416 to 3.1416'
    )


@settings(deadline=None)
@given(CHAINS)
def test_a_written_chain_is_read_as_it_was(chain):
    again = read(write(chain))
    assert len(again.segments) == len(chain.segments)
    for mine, theirs in zip(again.segments, chain.segments, strict=True):
        assert (mine.kind, mine.low, mine.high) == (theirs.kind, theirs.low, theirs.high)
        for a, b in zip(mine.frames, theirs.frames, strict=True):
            assert a.angles == pytest.approx(b.angles, rel=1e-12, abs=1e-15)
            assert a.shift == pytest.approx(b.shift, rel=1e-12, abs=1e-15)


WRONG = [
    ('', 'line 1: no element found'),
    ('<Segments>\n  <Segment>\n</Segments>', 'line 3: mismatched tag'),
    ('<Robot/>', "line 1: the root element is 'Robot', wanted 'Segments'"),
    ('<Segments/>', 'line 1: no Segment in it'),
    ('<Segments>\n<Link/></Segments>', "line 2: 'Link', wanted 'Segment'"),
    ('<Segments>\n<Segment/></Segments>', 'line 2: Segment without JointType'),
    ('<Segments><Segment>\n<JointType>Rot</JointType></Segment></Segments>', "line 2: JointType 'Rot'; known are"),
    (PRINTED.replace('75.0', '7,5'), "line 14: X is '7,5', no number"),
    (PRINTED.replace('75.0', 'nan'), 'line 14: X is nan; at most 1e\\+06'),
    (PRINTED.replace('75.0', '1e300'), 'line 14: X is 1e300; at most'),
    (PRINTED.replace('<Alfa>', '<Alpha>').replace('</Alfa>', '</Alpha>'), "line 9: 'Alpha' in Frame; known are Alfa"),
    (PRINTED.replace('<Y>0.0</Y>', '<X>0.0</X>', 1), 'line 15: X is given twice'),
    (PRINTED.replace('-1.57079632679', '3.0'), 'line 20: MinAngle 3 is not below MaxAngle'),
    ('<Segments a="1"/>', 'line 1: <Segments> has attributes'),
    ('<!DOCTYPE x [<!ENTITY a "b">]><Segments>&a;</Segments>', 'line 1: document types and entities are not read'),
    ('<a>' * 30, 'nested more than 20 deep'),
    (b'\xff\xfe\x00\x01', 'line 1'),
    ('<?xml version="1.0" encoding="no-such"?><Segments/>', 'line 1'),
    ('<Segments>' + 'x' * 1_000_001, 'at most 1000000'),
]  # fmt: skip


@pytest.mark.parametrize(('text', 'said'), WRONG)
def test_what_is_wrong_is_told_with_its_line(text, said):
    with pytest.raises(XmlError, match=said):
        read(text)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, len(PRINTED) - 1), st.integers(0, 40), st.binary(max_size=12))
def test_damaged_files_are_read_or_refused(at, length, other):
    raw = PRINTED.encode()
    try:
        read(raw[:at] + other + raw[at + length :])
    except XmlError as e:
        assert str(e).startswith('line ')


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=80))
def test_any_bytes_are_read_or_refused(raw):
    for data in (raw, b'<Segments>' + raw + b'</Segments>'):
        try:
            parse(data)
        except XmlError as e:
            assert e.line >= 1


def changed(number, **values):
    segments = list(chain_of(M20IB25).segments)
    old = segments[number]
    new = {'kind': old.kind, 'low': old.low, 'high': old.high, 'frames': old.frames} | values
    segments[number] = Segment(**new)
    return Chain(tuple(segments))


@pytest.mark.parametrize(
    ('chain', 'said'),
    [
        (read(PRINTED), 'joints are RotZ RotY; the analytic inverse wants RotZ RotY RotY'),
        (changed(1, frames=(Frame(shift=(0, 0.02, 0.9)),)), r'behind joint 2 shift by \[ *0. *20. *900.\] mm'),
        (changed(4, frames=(Frame(angles=(0.1, 0, 0)),)), 'frames behind joint 5 turn'),
        (Chain((Segment('Fixed'), *chain_of(M20IB25).segments)), 'the first segment has to be joint 1'),
    ],
)  # fmt: skip
def test_a_chain_without_an_analytic_inverse_is_refused_by_what_it_has(chain, said):
    with pytest.raises(ArmError, match=said):
        arm_of(chain)


def test_a_chain_wants_as_many_angles_as_joints():
    with pytest.raises(ValueError, match='has 2 joints'):
        read(PRINTED).forward(np.zeros(3))


def test_points_go_out_and_come_back():
    theta = np.radians([[30, 60, -20, 40, 50, 60], [0, 90, 0, 0, 10, 0]])
    poses = forward(M20IB25, theta)
    lines = pose_lines(poses).splitlines()
    text = '\n'.join(
        '; '.join(map(str, t)) + '; ' + line for t, line in zip(theta, lines, strict=True)
    )
    before, again = read_inverse(text)
    assert before == pytest.approx(theta) and again == pytest.approx(poses, abs=1e-9)
    assert lines[0].split('; ')[9:] == [f'{v * 1e3:.10f}' for v in poses[0, :3, 3]]


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('', 'no line with numbers'),
        ('0; 1; 2', 'line 1: 3 numbers between ";", wanted six angles'),
        ('\n0; 1; 2; 3; 4; a', 'line 2: "0; 1; 2; 3; 4; a" holds no number'),
        ('0; 1; 2; 3; 4; inf', 'line 1: a number that is not finite'),
    ],
)
def test_wrong_point_files_are_told_with_the_line(text, said):
    with pytest.raises(PointsError, match=said):
        read_angles(text)


def test_the_sources_example_of_an_inverse_line_is_refused():
    example = (
        '0.0; 1.5708; 0.5315; 2.5792; 0.1; 0.6518; 0; -1; 1; 1; -0.7071; -0.7071; -0.0000; -0.7071; 0.7071; 0.0000; '
        '0.0000; 0.0000; -1.0000; -1.4142; 3.8284; 0.0000.'
    )
    with pytest.raises(PointsError, match='line 1: 22 numbers'):
        read_inverse(example)
    assert read_angles(example[:41]) == pytest.approx(
        np.array([[0, 1.5708, 0.5315, 2.5792, 0.1, 0.6518]])
    )


def test_a_matrix_that_is_no_rotation_is_refused():
    with pytest.raises(PointsError, match='point 0: no rotation'):
        read_inverse('0;0;0;0;0;0; 1;0;0; 0;1;0; 0;0;2; 100;0;0')


@settings(max_examples=150, deadline=None)
@given(st.text(alphabet='0123456789.;-e \nnai', max_size=60))
def test_any_text_is_numbers_or_refused(text):
    for reader in (read_angles, read_inverse):
        try:
            reader(text)
        except PointsError as e:
            assert str(e)
