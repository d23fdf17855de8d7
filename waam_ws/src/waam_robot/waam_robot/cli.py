"""waam robot: kinematics of the arm on the command line."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # numpy is loaded only when a verb runs
    import numpy as np

    from .joints import Counting

EPILOG = """\
examples:
  waam robot fk 30 60 -20 40 50 60                        joint angles in degrees -> flange and tool, mm and degrees
  waam robot fk 0 0 0 0 0 0 --zero vertical --coupled     counted as the pendant does
  waam robot ik 1211.277 299.969 853.587 -90.8 -35.6 -28  a pose -> all branches, and which limits they break
  waam robot urdf -o cell.urdf                            arm and tilt-turn positioner for other programs

The arm is the M-20iB/25 of source 003. No robot is moved by any of this.
"""


def register(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds the verb to argparse sub-parsers."""
    p = commands.add_parser(
        'robot',
        help='kinematics of a robot arm',
        description='Forward and inverse kinematics of a six-axis arm; it with its positioner as a URDF.',
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = p.add_subparsers(dest='robot_command', metavar='VERB', required=True)
    for name, names, unit, text, verb in (
        ('fk', 'J1 J2 J3 J4 J5 J6', 'degrees', 'joint angles -> where flange and tool are', forward_verb),
        ('ik', 'X Y Z W P R', 'mm and degrees', 'where the tool is -> joint angles, all branches', inverse_verb),
    ):  # fmt: skip
        p = verbs.add_parser(name, help=text, description=text)
        p.add_argument('numbers', type=float, nargs='*', metavar='N', help=f'{names}, {unit}')
        p.add_argument(
            '--zero',
            choices=('dh', 'vertical'),
            default='dh',
            help='J2 = 0: upper arm horizontal (DH table, default) or upright (pendant)',
        )
        p.add_argument(
            '--coupled', action='store_true', help='J3 is the forearm against the base (pendant)'
        )
        _finish(p, verb)
    _finish(
        verbs.add_parser('urdf', help='write the arm with a tilt-turn positioner as a URDF'),
        write_urdf_verb,
    )


def _finish(p: argparse.ArgumentParser, verb: Callable[[argparse.Namespace], str]) -> None:
    p.add_argument('-o', '--output', type=Path, metavar='FILE', help='default: the screen')
    p.set_defaults(run_command=_guarded, verb=verb)


def _guarded(args: argparse.Namespace) -> int:
    """0, or 2 with one line of error."""
    try:
        text = args.verb(args)
        if args.output:
            args.output.write_text(text)
            print(f'written: {args.output}')
        else:
            print(text, end='')
    except (ValueError, OSError) as error:
        print(f'waam robot {args.robot_command}: {error}', file=sys.stderr)
        return 2
    return 0


# ---- verbs: arguments -> text ------------------------------------------------------------------


def write_urdf_verb(_args: argparse.Namespace) -> str:
    """Arm and positioner, drawn as plain cylinders."""
    from .positioner import Machine
    from .timing import Drives
    from .urdf_text import write_urdf

    return write_urdf(Machine(), Drives().speed)


def forward_verb(args: argparse.Namespace) -> str:
    """Flange and tool of one set of angles."""
    import numpy as np

    from .arm import M20IB25, forward, limit_text

    angles = np.radians(_numbers(args, 'joint angles in degrees'))
    theta = _counting(args).to_dh(angles)
    beyond = limit_text(M20IB25, theta)
    return (
        _pose_text('flange', forward(M20IB25, theta, tool=False))
        + _pose_text('tool', forward(M20IB25, theta))
        + (f'limits: {beyond}\n' if beyond else '')
    )


def inverse_verb(args: argparse.Namespace) -> str:
    """A table of the branches of one pose."""
    import numpy as np

    from . import inverse
    from .arm import M20IB25, ArmError, limit_text
    from .frames import pose_from_wpr
    from .joints import Counting

    numbers = _numbers(args, 'X Y Z in mm and W P R in degrees')
    pose = pose_from_wpr(numbers[:3] * 1e-3, np.radians(numbers[3:]))
    found = inverse.solve(M20IB25, pose[None])
    if not found.any[0]:
        raise ArmError(inverse.unreachable_text(M20IB25, found, 0))
    lines = ['branch    J1       J2       J3       J4       J5       J6   deg']
    for b in range(inverse.BRANCHES):
        theta = found.theta[0, b]
        if not found.reachable[0, b]:
            lines.append(f'{b:4d}    out of reach (k = {found.stretch[0, b // 4]:.3f})')
            continue
        shown = np.degrees(_counting(args).from_dh(theta))
        columns = ' '.join(f'{v:8.3f}' for v in shown)
        lines.append(f'{b:4d}  {columns}  {limit_text(M20IB25, theta)}'.rstrip())
    if _counting(args) != Counting():
        lines.append('# limits: theta2 and theta3 as the DH table counts them, not as the columns')
    return '\n'.join(lines) + '\n'


# ---- arguments ---------------------------------------------------------------------------------


def _numbers(args: argparse.Namespace, wanted: str) -> np.ndarray:
    import numpy as np

    if len(args.numbers) != 6:
        raise ValueError(f'{len(args.numbers)} numbers given; wanted six: {wanted}')
    if not np.isfinite(args.numbers).all():
        raise ValueError('a number that is not finite')
    return np.array(args.numbers)


def _counting(args: argparse.Namespace) -> Counting:
    from .joints import Counting

    return Counting(args.zero, args.coupled)


def _pose_text(name: str, pose: np.ndarray) -> str:
    import numpy as np

    from .frames import wpr

    x, y, z = pose[:3, 3] * 1e3
    w, p, r = np.degrees(wpr(pose))
    return f'{name:7s} X {x:9.3f}  Y {y:9.3f}  Z {z:9.3f} mm   W {w:8.3f}  P {p:8.3f}  R {r:8.3f} deg\n'
