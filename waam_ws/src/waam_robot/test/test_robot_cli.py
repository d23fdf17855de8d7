"""waam robot: what is printed; mistakes of use are one line and status 2."""

from __future__ import annotations

import argparse

import pytest

from waam_robot import cli
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
        (['split', 'missing.txt'], 'missing.txt'),
        (['split', 'bad.txt'], 'bad.txt, line 1: 1 numbers'),
        (['split', 'points.txt', '--delta0', '-1'], 'split: delta0 = -0.001: wanted a positive number'),
        (['split', 'points.txt', '--speed', '20', '--turn-speed', '0'], '--turn-speed 0: wanted a positive'),
        (['split', 'points.txt', '--speed', '0'], '--speed 0: wanted a positive'),
        (['split', 'points.txt', '--speed', '20', '--r-crit', '9'], 'give one of them'),
        (['split', 'bytes.bin'], 'bytes.bin: no text'),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(waam, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'bad.txt').write_text('100')
    (tmp_path / 'points.txt').write_text('100; 0; 0; 0; 0; 0\n')
    (tmp_path / 'bytes.bin').write_bytes(b'\xff\x00\xfe')
    status, _, err = waam(*words)
    assert status == 2 and said in err and len(err.splitlines()) == 1


def test_help_teaches(waam, capsys):
    with pytest.raises(SystemExit):
        waam('--help')
    assert 'points.txt' in capsys.readouterr().out
