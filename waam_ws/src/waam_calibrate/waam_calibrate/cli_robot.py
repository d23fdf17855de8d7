"""`waam calibrate robot-tcp | hand-eye`: the tool of a robot and the scanner on it."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from .cli_common import folder, keep, verb

if TYPE_CHECKING:  # numpy and scipy are loaded only when a verb runs
    import numpy as np

    from .cli_common import Verbs
    from .graph import Graph
    from .results import Result
    from .robot_evidence import Robot

FILES = """\
The first line of the file names its columns: j1 ... j6, joint angles in degrees of the M-20iB/25 (--zero, --coupled:
how your pendant counts), or x y z w p r, the flange in the frame of the base, mm and degrees, of any robot.
"""
TCP = f"""\
Touch the tip of a fixed spike with the wire tip in 8 to 12 poses, the torch leaning by 20 to 40 degrees to all sides
and turned about itself, and write down the joints or the flange of each.

{FILES}"""
EYE = f"""\
Fix a sphere of known radius (a bearing ball, 10 to 25 mm, dull). Take one profile of it in 10 to 15 poses, from
different sides, the sphere at different places of the profile. Keep the points on the sphere only.

{FILES}Further columns: pose (a number), x_s z_s (a point of the profile, mm, frame of the scanner); a line for every
point.
"""


def register(verbs: Verbs, graph: Graph) -> None:
    """Adds both verbs."""
    p = verb(verbs, 'robot-tcp', "tip of a robot's tool, from touches of a fixed point", graph)
    p.epilog = TCP
    _add_evidence(p, 'touches')
    p.add_argument(
        '--touch', type=float, default=0.1, metavar='MM', help='uncertainty of a touch (0.1)'
    )
    p.add_argument(
        '--told', nargs=3, type=float, default=(290.0, 0.0, 90.0), metavar=('X', 'Y', 'Z'),
        help='tool of the controller now, mm, frame of the flange (290 0 90)',
    )  # fmt: skip
    p.set_defaults(run_command=lambda args: robot_tcp(args, graph))
    p = verb(verbs, 'hand-eye', 'scanner on the arm of a robot, from profiles of a sphere', graph)
    p.epilog = EYE
    _add_evidence(p, 'profiles')
    p.add_argument('--radius', type=float, default=15.0, metavar='MM', help='of the sphere (15)')
    p.add_argument(
        '--noise', type=float, default=0.05, metavar='MM', help='uncertainty of a point (0.05)'
    )
    p.add_argument(
        '--mounted', nargs=6, type=float, default=(60.0, 0.0, 120.0, 0.0, 0.0, 90.0),
        metavar=('X', 'Y', 'Z', 'ROLL', 'PITCH', 'YAW'),
        help='scanner on the torch as mounted, mm and degrees (60 0 120 0 0 90): where the search begins',
    )  # fmt: skip
    p.set_defaults(run_command=lambda args: hand_eye(args, graph))


def _add_evidence(p: argparse.ArgumentParser, what: str) -> None:
    given = p.add_mutually_exclusive_group(required=True)
    given.add_argument('--file', type=Path, help=f'the {what}: lines of numbers, see below')
    given.add_argument(
        '--rehearse', type=int, metavar='SEED',
        help='on a simulated robot with the stated errors; nothing is kept',
    )  # fmt: skip
    p.add_argument('--zero', choices=('dh', 'vertical'), default='dh', help='where J2 is 0')
    p.add_argument(
        '--coupled', action='store_true', help='J3 is that of the forearm against the base'
    )
    p.add_argument(
        '--accuracy', nargs=2, type=float, default=(0.2, 0.02), metavar=('MM', 'DEG'),
        help='of a pose of the flange, where the file has no joints (0.2 0.02)',
    )  # fmt: skip


def robot_tcp(args: argparse.Namespace, graph: Graph) -> int:
    """Tip of the tool. EvidenceError where the touches do not tell it."""
    import numpy as np

    from . import outcome_robot, pictures_robot, robot_evidence, robot_fit

    text, truth = _evidence(args, graph, 'touches')
    with _of_file(args.file):
        found = robot_fit.tool(robot_evidence.touches(text, _robot(args)), args.touch * 1e-3)
    told = np.array(args.told) * 1e-3
    result = outcome_robot.of_tool(found, told, datetime.now(UTC))
    notes = ['tool of the controller, mm: ' + ' '.join(f'{v * 1e3:.3f}' for v in found.tip)]
    if truth is not None:
        return _rehearsed(result, notes, found.tip - truth[:3, 3], found.interval)
    keep(folder(args, graph), result, notes, [pictures_robot.touches(found)])
    return 0


def hand_eye(args: argparse.Namespace, graph: Graph) -> int:
    """Scanner on the arm. EvidenceError where the profiles do not tell it."""
    import numpy as np

    from waam_robot.frames import pose_from_wpr
    from waam_robot.station import Station

    from . import outcome_robot, pictures_robot, robot_evidence, robot_fit

    text, truth = _evidence(args, graph, 'profiles')
    station = Station()
    mounted = pose_from_wpr(np.array(args.mounted[:3]) * 1e-3, np.radians(args.mounted[3:]))
    with _of_file(args.file):
        seen = robot_evidence.profiles(text, _robot(args))
        found = robot_fit.hand_eye(
            seen, args.radius * 1e-3, station.on_flange(mounted), args.noise * 1e-3
        )
    on_torch = station.on_torch(found.scanner)
    result = outcome_robot.of_hand_eye(found, on_torch, mounted, datetime.now(UTC))
    notes = outcome_robot.scan_parameters(on_torch)
    if truth is not None:
        return _rehearsed(result, notes, found.scanner[:3, 3] - truth[:3, 3], found.interval[:3])
    keep(folder(args, graph), result, notes, [pictures_robot.profiles(found)])
    return 0


@contextmanager
def _of_file(file: Path | None) -> Iterator[None]:
    """Poor evidence is told with the name of its file."""
    from .evidence import EvidenceError

    try:
        yield
    except EvidenceError as e:
        raise EvidenceError(f'{file}: {e}' if file else str(e)) from None


def _evidence(args: argparse.Namespace, graph: Graph, what: str) -> tuple[str, np.ndarray | None]:
    """Text of the file; or of a rehearsal, with the truth (4, 4)."""
    if args.rehearse is None:
        return args.file.read_text(errors='replace'), None
    if graph.rehearse is None:
        raise ValueError('--rehearse needs the laboratory: call it as `waam calibrate`')
    return graph.rehearse(what, args.rehearse)


def _robot(args: argparse.Namespace) -> Robot:
    import math

    from waam_robot.joints import Counting

    from .robot_evidence import Robot

    position, angle = args.accuracy
    if not (position > 0 and angle > 0):
        raise ValueError('--accuracy: wanted two positive numbers')
    counting = Counting(args.zero, args.coupled)
    return Robot(counting, position=position * 1e-3, angle=math.radians(angle))


def _rehearsed(result: Result, notes: list[str], off: np.ndarray, interval: np.ndarray) -> int:
    lines = [result.text, *notes, 'against the truth of the simulated robot:']
    for axis, miss, half in zip('xyz', off * 1e3, interval * 1e3, strict=True):
        lines.append(f'  {axis} off by {miss:+.3f} mm, 95 % interval +-{half:.3f} mm')
    print('\n'.join([*lines, 'a rehearsal: nothing is kept']))
    return 0
