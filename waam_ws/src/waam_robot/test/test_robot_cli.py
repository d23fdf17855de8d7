"""waam robot: the source's files go through; mistakes of use are one line and status 2."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

from waam_robot import cli
from waam_robot.arm import M20IB25, forward
from waam_robot.config_xml import to_file
from waam_robot.points import pose_lines
from waam_robot.urdf_text import check_urdf


@pytest.fixture
def waam(capsys):
    """Runs a command line; gives status, what was printed, what was complained about."""
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers())

    def run(*words):
        args = parser.parse_args(['robot', *map(str, words)])
        status = args.run_command(args)
        said = capsys.readouterr()
        return status, said.out, said.err

    return run


def test_angles_to_pose(waam):
    status, out, _ = waam('fk', 30, 60, -20, 40, 50, 60)
    assert status == 0
    assert 'X  1117.291  Y   588.210  Z   836.739 mm' in out
    assert 'X  1211.277  Y   299.969  Z   853.587 mm' in out
    assert waam('fk', 0, 0, 0, 0, 0, 0, '--zero', 'vertical', '--coupled')[1].count('1675.000') == 1
    assert 'limits: theta1 is 190.0 deg' in waam('fk', 190, 60, 0, 0, 0, 0)[1]


def test_pose_to_branches(waam):
    status, out, _ = waam('ik', 1130, 0, 1965, 180, -90, 0)
    assert status == 0 and len(out.splitlines()) == 9
    pendant = waam('ik', 1130, 0, 1965, 180, -90, 0, '--zero', 'vertical')[1]
    assert 'as the DH table counts them' in pendant and 'DH table' not in out
    status, out, err = waam('ik', 3000, 0, 0, 0, 0, 0)
    assert (status, out) == (2, '') and err.startswith(
        'waam robot ik: out of reach: its wrist would be at'
    )


def test_files_of_the_source_there_and_back(waam, tmp_path):
    xml, points, poses, back = (tmp_path / n for n in ('robot.xml', 'f.txt', 'p.txt', 'b.txt'))
    assert waam('xml', '-o', xml)[0] == 0
    theta = np.radians([[10, 60, -20, 40, 50, 60], [15, 62, -22, 45, 55, 65]])
    told = to_file(theta)
    points.write_text('\n'.join('; '.join(map(repr, row.tolist())) for row in told))
    assert waam('fk', '-c', xml, '-i', points, '-o', poses)[0] == 0
    wanted = forward(M20IB25, theta)
    wanted[:, 2, 3] -= 0.650
    assert poses.read_text() == pose_lines(wanted)
    near = [row + 0.05 for row in told]
    lines = zip(near, poses.read_text().splitlines(), strict=True)
    inverse = tmp_path / 'i.txt'
    inverse.write_text('\n'.join('; '.join(map(repr, n.tolist())) + '; ' + p for n, p in lines))
    assert waam('ik', '-c', xml, '-i', inverse, '-o', back)[0] == 0
    again = [[float(v) for v in line.split(';')] for line in back.read_text().splitlines()]
    assert np.array(again) == pytest.approx(told, abs=1e-8)


def segment(kind: str, **shift: float) -> str:
    moved = ''.join(f'<{axis}>{mm}</{axis}>' for axis, mm in shift.items())
    return f'<Segment><JointType>{kind}</JointType><Frame>{moved}</Frame></Segment>'


@pytest.mark.parametrize('joints', [1, 2, 5, 7])
def test_a_chain_of_any_number_of_joints(waam, tmp_path, joints):
    """Each turns about z and is 100 mm long: all at 10 degrees, the tip lies where the sum says."""
    link = segment('RotZ', X=100)
    xml, points = tmp_path / 'chain.xml', tmp_path / 'points.txt'
    fixed = segment('Fixed', Z=50)
    xml.write_text(f'<Segments>{fixed}{link * joints}</Segments>')
    turns = np.radians(10) * np.arange(1, joints + 1)
    x, y = 100 * np.cos(turns).sum(), 100 * np.sin(turns).sum()
    status, out, _ = waam('fk', '-c', xml, *[10] * joints)
    assert status == 0
    for name, value in (('X', x), ('Y', y), ('Z', 50.0)):
        assert f'{name} {value:9.3f}' in out
    points.write_text('; '.join(['0.1745329251994'] * joints))
    status, out, _ = waam('fk', '-c', xml, '-i', points)
    numbers = [float(v) for v in out.split(';')]
    assert status == 0 and numbers[9:] == pytest.approx([x, y, 50.0], abs=1e-6)
    wrong = waam('fk', '-c', xml, *[10] * (joints + 1))
    assert wrong[0] == 2 and f'the chain has {joints} joints, and {joints + 1} numbers' in wrong[2]
    points.write_text('; '.join(['0.1'] * (joints + 1)))
    assert f'{joints + 1} numbers' in waam('fk', '-c', xml, '-i', points)[2]
    xml.write_text(f'<Segments>{fixed}</Segments>')
    assert 'the chain has no joint' in waam('fk', '-c', xml, 1)[2]


def test_split_prints_table_2_2(waam, tmp_path):
    file = tmp_path / 'points.txt'
    file.write_text(
        '100.358; -4.530; 0.003; 19.953; 0.956; -89.576\n99.804; 5.455; 0.003; 19.698; 3.380; -96.297\n'
    )
    status, out, _ = waam('split', file, '--speed', 20)
    lines = out.splitlines()
    assert status == 0
    assert lines[1].startswith(
        '100.358; -4.530; 0.003; 19.975; 0.000; 267.416; -19.975; 267.416; 0'
    )
    assert lines[2].startswith(
        '99.804; 5.455; 0.003; 19.975; 0.000; 273.129; -19.975; 273.129; 1; 0.1248'
    )
    assert '0 of 1 moves by the robot alone; r_crit 6.03 mm' in lines[3]


def test_the_machine_as_a_urdf(waam):
    status, out, _ = waam('urdf')
    assert status == 0 and check_urdf(out) == out and '<joint name="turn"' in out


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['fk', 1, 2, 3], 'fk: 3 numbers given; wanted six'),
        (['fk', 1, 2, 3, 4, 5, 'nan'], 'fk: a number that is not finite'),
        (['fk', 1, '-i', 'x.txt'], 'fk: numbers and -i FILE: give one of them'),
        (['fk', '-i', 'missing.txt'], 'missing.txt'),
        (['fk', '-c', 'missing.xml', '-i', 'x'], 'missing.xml'),
        (['fk', '-c', 'bad.xml', '0', '0'], "bad.xml, line 1: the root element is 'a', wanted 'Segments'"),
        (['ik', '-c', 'short.xml', *'000000'], 'short.xml: joints are RotZ; the analytic inverse wants'),
        (['fk', '-c', 'short.xml', *'000000'], 'fk: the chain has 1 joints'),
        (['fk', '-c', 'short.xml', '--coupled', *'000000'], 'do not go with -c'),
        (['ik', '-i', 'far.txt'], 'far.txt: pose 0: out of reach'),
        (['split', 'bad.xml'], 'bad.xml, line 1: 1 numbers'),
        (['split', 'points.txt', '--delta0', '-1'], 'split: delta0 = -0.001: wanted a positive number'),
        (['split', 'points.txt', '--speed', '20', '--turn-speed', '0'], '--turn-speed 0: wanted a positive'),
        (['split', 'points.txt', '--speed', '0'], '--speed 0: wanted a positive'),
        (['split', 'points.txt', '--speed', '20', '--r-crit', '9'], 'give one of them'),
        (['split', 'bytes.bin'], 'bytes.bin: no text'),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(waam, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'bad.xml').write_text('<a/>')
    (tmp_path / 'short.xml').write_text(
        '<Segments><Segment><JointType>RotZ</JointType></Segment></Segments>'
    )
    (tmp_path / 'far.txt').write_text('0;0;0;0;0;0; 1;0;0; 0;1;0; 0;0;1; 9000;0;0')
    (tmp_path / 'points.txt').write_text('100; 0; 0; 0; 0; 0\n')
    (tmp_path / 'bytes.bin').write_bytes(b'\xff\x00\xfe')
    status, _, err = waam(*words)
    assert status == 2 and said in err and len(err.splitlines()) == 1


def test_help_teaches(waam, capsys):
    with pytest.raises(SystemExit):
        waam('--help')
    assert 'f_input' in capsys.readouterr().out
