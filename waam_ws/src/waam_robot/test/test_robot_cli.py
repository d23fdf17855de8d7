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


def test_the_machine_as_a_urdf(waam):
    status, out, _ = waam('urdf')
    assert status == 0 and check_urdf(out) == out and '<joint name="turn"' in out


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['fk', 1, 2, 3], 'fk: 3 numbers given; wanted six'),
        (['fk', 1, 2, 3, 4, 5, 'nan'], 'fk: a number that is not finite'),
    ],
)  # fmt: skip
def test_mistakes_are_one_line(waam, words, said):
    status, _, err = waam(*words)
    assert status == 2 and said in err and len(err.splitlines()) == 1


def test_help_teaches(waam, capsys):
    with pytest.raises(SystemExit):
        waam('--help')
    assert '--coupled' in capsys.readouterr().out
