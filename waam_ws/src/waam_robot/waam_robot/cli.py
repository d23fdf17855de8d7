"""waam robot: kinematics and motion split on the command line, with the files of the source's program."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:  # numpy is loaded only when a verb runs
    import numpy as np

    from .arm import Arm
    from .config_xml import Chain
    from .joints import Counting

Read = TypeVar('Read')

EPILOG = """\
examples:
  waam robot fk 30 60 -20 40 50 60                        joint angles in degrees -> flange and tool, mm and degrees
  waam robot fk 0 0 0 0 0 0 --zero vertical --coupled     counted as the pendant does
  waam robot ik 1211.277 299.969 853.587 -90.8 -35.6 -28  a pose -> all branches, and which limits they break
  waam robot xml -o robot.xml                             the arm of the source as its own XML
  waam robot urdf -o cell.urdf                            arm and tilt-turn positioner for other programs
  waam robot fk -c robot.xml -i f_input.txt -o f_output.txt     the source's files: angles -> poses
  waam robot ik -c robot.xml -i i_input.txt -o i_output.txt     poses -> angles, branch nearest to the state before
  waam robot split points.txt -o split.txt --speed 20     a path divided between robot and positioner

Files hold one point per line, numbers between semicolons. f_input: six angles, rad (with -c one per joint).
i_input: six angles of the state before, the rotation matrix by rows, x; y; z in mm.
split: X; Y; Z (mm); W; P; R (deg) of the tool on the part.
With -c, angles are those of the XML: J2 = 0 upright, J3 against the upper arm.

The arm without -c is the M-20iB/25 of source 003. No robot is moved by any of this.
"""


def register(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds the verb to argparse sub-parsers."""
    p = commands.add_parser(
        'robot',
        help='kinematics of a robot arm; a path divided between robot and positioner',
        description='Forward and inverse kinematics of a six-axis arm, and the motion split with a positioner.',
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = p.add_subparsers(dest='robot_command', metavar='VERB', required=True)
    _register_kinematics(verbs)
    _register_split(verbs)
    xml = verbs.add_parser('xml', help="write the source's arm as its XML")
    _add_output(xml)
    xml.set_defaults(run_command=_guarded, verb=write_xml)
    urdf = verbs.add_parser('urdf', help='write the arm with a tilt-turn positioner as a URDF')
    _add_output(urdf)
    urdf.set_defaults(run_command=_guarded, verb=write_urdf_verb)


def _register_kinematics(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    for name, names, text, verb in (
        (
            'fk',
            'J1 J2 J3 J4 J5 J6 (with -c: of its joints)',
            'joint angles -> where flange and tool are',
            forward_verb,
        ),
        ('ik', 'X Y Z W P R', 'where the tool is -> joint angles, all branches', inverse_verb),
    ):
        p = verbs.add_parser(name, help=text, description=text)
        unit = 'degrees' if name == 'fk' else 'mm and degrees'
        p.add_argument('numbers', type=float, nargs='*', metavar='N', help=f'{names}, {unit}')
        p.add_argument('-c', '--config', type=Path, metavar='XML', help="arm in the source's XML")
        p.add_argument('-i', '--input', type=Path, metavar='FILE', help='points to compute')
        _add_output(p)
        p.add_argument(
            '--zero',
            choices=('dh', 'vertical'),
            default='dh',
            help='J2 = 0: upper arm horizontal (DH table, default) or upright (pendant)',
        )
        p.add_argument(
            '--coupled', action='store_true', help='J3 is the forearm against the base (pendant)'
        )
        p.set_defaults(run_command=_guarded, verb=verb)


def _register_split(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    text = 'divide a path between robot and positioner'
    p = verbs.add_parser('split', help=text, description=text)
    p.add_argument('points', type=Path, metavar='FILE', help='X; Y; Z; W; P; R per line')
    _add_output(p)
    p.add_argument(
        '--delta0', type=float, default=0.2, metavar='MM', help='arc off its chord, default 0.2 mm'
    )
    p.add_argument(
        '--delta1', type=float, default=0.02, help='relative change of the radius, default 0.02'
    )
    p.add_argument(
        '--r-crit', type=float, metavar='MM', help='nearer to the axis the robot is alone; 10 mm'
    )
    p.add_argument(
        '--speed', type=float, metavar='MM/S', help='r-crit from travel speed over --turn-speed'
    )
    p.add_argument('--turn-speed', type=float, default=190.0, metavar='DEG/S', help='default 190')
    p.set_defaults(run_command=_guarded, verb=split_verb)


def _add_output(p: argparse.ArgumentParser) -> None:
    p.add_argument('-o', '--output', type=Path, metavar='FILE', help='default: the screen')


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


def write_xml(_args: argparse.Namespace) -> str:
    """The source's arm as XML."""
    from . import config_xml
    from .arm import M20IB25

    return config_xml.write(config_xml.chain_of(M20IB25))


def write_urdf_verb(_args: argparse.Namespace) -> str:
    """Arm and positioner, drawn as plain cylinders."""
    from .joint_path import Machine
    from .timing import Drives
    from .urdf_text import write_urdf

    return write_urdf(Machine(), Drives().speed)


def forward_verb(args: argparse.Namespace) -> str:
    """A file of poses, or flange and tool of one set of angles."""
    import numpy as np

    from . import points
    from .arm import AXES, M20IB25, forward, limit_text

    chain = _chain(args)
    joints = len(chain.joints) if chain else AXES
    if not joints:
        raise ValueError(f'{args.config}: the chain has no joint')
    if args.input:
        angles = _read(args.input, lambda text: points.read_angles(text, joints))
        poses = chain.forward(angles) if chain else forward(M20IB25, _counting(args).to_dh(angles))
        return points.pose_lines(poses)
    if chain and len(args.numbers) != joints:
        told = f'the chain has {joints} joints, and {len(args.numbers)} numbers are given'
        raise ValueError(f'{told}; wanted their angles in degrees, or -i FILE')
    angles = np.radians(_numbers(args, joints, 'joint angles in degrees, or -i FILE'))
    if chain:
        tip = _pose_text('tip', chain.forward(angles))
        beyond = chain.beyond(angles)
        return tip + (f'limits: {beyond}\n' if beyond else '')
    theta = _counting(args).to_dh(angles)
    beyond = limit_text(M20IB25, theta)
    return (
        _pose_text('flange', forward(M20IB25, theta, tool=False))
        + _pose_text('tool', forward(M20IB25, theta))
        + (f'limits: {beyond}\n' if beyond else '')
    )


def inverse_verb(args: argparse.Namespace) -> str:
    """A file of angles, or a table of the branches of one pose."""
    import numpy as np

    from . import config_xml, inverse, points
    from .arm import M20IB25, ArmError
    from .frames import pose_from_wpr

    chain = _chain(args)
    arm = config_xml.arm_of(chain, args.config.name) if chain else M20IB25
    if args.input:
        before, poses = _read(args.input, points.read_inverse)
        to_dh = config_xml.from_file if chain else _counting(args).to_dh
        from_dh = config_xml.to_file if chain else _counting(args).from_dh
        found = inverse.solve(arm, poses)
        try:
            chosen = [inverse.choose(arm, found, n, to_dh(b))[1] for n, b in enumerate(before)]
        except ArmError as e:
            raise ValueError(f'{args.input}: {e} (points count from 0)') from None
        return points.number_lines(from_dh(np.array(chosen)))
    numbers = _numbers(args, 6, 'X Y Z in mm and W P R in degrees, or -i FILE')
    pose = pose_from_wpr(numbers[:3] * 1e-3, np.radians(numbers[3:]))
    return _branch_table(arm, pose, args, chain is not None)


def _branch_table(arm: Arm, pose: np.ndarray, args: argparse.Namespace, of_file: bool) -> str:
    import numpy as np

    from . import config_xml, inverse
    from .arm import ArmError, limit_text
    from .joints import Counting

    found = inverse.solve(arm, pose[None])
    if not found.any[0]:
        raise ArmError(inverse.unreachable_text(arm, found, 0))
    lines = ['branch    J1       J2       J3       J4       J5       J6   deg']
    for b in range(inverse.BRANCHES):
        theta = found.theta[0, b]
        if not found.reachable[0, b]:
            lines.append(f'{b:4d}    out of reach (k = {found.stretch[0, b // 4]:.3f})')
            continue
        told = config_xml.to_file(theta) if of_file else _counting(args).from_dh(theta)
        numbers = ' '.join(f'{v:8.3f}' for v in np.degrees(told))
        lines.append(f'{b:4d}  {numbers}  {limit_text(arm, theta)}'.rstrip())
    if not of_file and _counting(args) != Counting():
        lines.append('# limits: theta2 and theta3 as the DH table counts them, not as the columns')
    return '\n'.join(lines) + '\n'


def split_verb(args: argparse.Namespace) -> str:
    """X; Y; Z; W; P; R; B; C; turns; delta0; delta1 per point, as the source's table 2.2 (W = -B, P = 0, R = C)."""
    import numpy as np

    from . import points, split
    from .frames import pose_from_wpr

    numbers = _read(args.points, lambda t: points.read_numbers(t, 6, 'X; Y; Z (mm); W; P; R (deg)'))
    if args.speed is not None and args.r_crit is not None:
        raise ValueError('--speed computes r-crit: give one of them')
    r_crit = 10e-3 if args.r_crit is None else args.r_crit * 1e-3
    if args.speed is not None:
        for name, value in (('speed', args.speed), ('turn-speed', args.turn_speed)):
            if not value > 0:
                raise ValueError(f'--{name} {value:g}: wanted a positive number')
        r_crit = split.critical_radius(args.speed * 1e-3, float(np.radians(args.turn_speed)))
    limits = split.SplitLimits(args.delta0 * 1e-3, args.delta1, r_crit)
    found = split.split(
        pose_from_wpr(numbers[:, :3] * 1e-3, np.radians(numbers[:, 3:])), limits=limits
    )
    place, angles = found.program
    lines = ['# X; Y; Z mm; W; P; R; B; C deg; positioner turns; delta0 mm; delta1']
    for n in range(len(place)):
        values = [*(place[n] * 1e3), *np.degrees(angles[n]), *np.degrees([found.b[n], found.c[n]])]
        said = '; '.join(f'{v + 0.0:.3f}' for v in values)
        turns = int(found.turns[n])
        lines.append(f'{said}; {turns}; {found.delta0[n] * 1e3:.4f}; {found.delta1[n]:.6f}')
    alone = int((~found.turns[1:]).sum())
    lines.append(
        f'# {alone} of {len(place) - 1} moves by the robot alone; r_crit {r_crit * 1e3:.2f} mm'
    )
    lean = np.degrees(found.leaning.max())
    lines.append(f'# the upright torch leans {lean:.2f} deg off the given one at most')
    return '\n'.join(lines) + '\n'


# ---- arguments ---------------------------------------------------------------------------------


def _numbers(args: argparse.Namespace, count: int, wanted: str) -> np.ndarray:
    import numpy as np

    if len(args.numbers) != count:
        told = 'six' if count == 6 else str(count)
        raise ValueError(f'{len(args.numbers)} numbers given; wanted {told}: {wanted}')
    if not np.isfinite(args.numbers).all():
        raise ValueError('a number that is not finite')
    return np.array(args.numbers)


def _counting(args: argparse.Namespace) -> Counting:
    from .joints import Counting

    return Counting(args.zero, args.coupled)


def _chain(args: argparse.Namespace) -> Chain | None:
    if args.input and args.numbers:
        raise ValueError('numbers and -i FILE: give one of them')
    if args.config is None:
        return None
    if args.coupled or args.zero != 'dh':
        raise ValueError('--zero and --coupled do not go with -c: the XML says how angles count')
    from . import config_xml

    try:
        return config_xml.read(args.config.read_bytes())
    except ValueError as e:
        raise ValueError(f'{args.config}, {e}') from None


def _read(file: Path, reader: Callable[[str], Read]) -> Read:
    """What the reader makes of the file; its errors with the name of the file."""
    try:
        return reader(file.read_text(encoding='utf-8'))
    except UnicodeDecodeError:
        raise ValueError(f'{file}: no text') from None
    except ValueError as e:
        raise ValueError(f'{file}, {e}') from None


def _pose_text(name: str, pose: np.ndarray) -> str:
    import numpy as np

    from .frames import wpr

    x, y, z = pose[:3, 3] * 1e3
    w, p, r = np.degrees(wpr(pose))
    return f'{name:7s} X {x:9.3f}  Y {y:9.3f}  Z {z:9.3f} mm   W {w:8.3f}  P {p:8.3f}  R {r:8.3f} deg\n'
