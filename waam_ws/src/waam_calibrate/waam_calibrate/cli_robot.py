"""`waam calibrate robot-tcp | hand-eye`: the tool of a robot and the scanner on it."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .cli_common import WANTED, folder, keep

if TYPE_CHECKING:  # numpy and scipy are loaded only when a verb runs
    import numpy as np

    from .graph import Graph
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


FILE = ('--file', Path, 'lines of numbers, see below', None, WANTED)
ROBOT = (
    ('--zero', 'dh', 'where J2 is 0', None, {'choices': ('dh', 'vertical')}),
    ('--coupled', False, 'J3 is that of the forearm against the base'),
    ('--accuracy', (0.2, 0.02), 'of a pose of the flange, where the file has no joints (0.2 0.02)', ('MM', 'DEG')),
)  # fmt: skip


def register(add: Callable[..., Any]) -> None:
    """Adds both verbs; add: as of `cli.register`."""
    axes = ('X', 'Y', 'Z')
    add(
        'robot-tcp', robot_tcp, "tip of a robot's tool, from touches of a fixed point",
        ('--touch', 0.1, 'uncertainty of a touch (0.1)', 'MM'),
        ('--told', (290.0, 0.0, 90.0), 'tool of the controller now, mm, frame of the flange (290 0 90)', axes),
        FILE, *ROBOT, epilog=TCP,
    )  # fmt: skip
    add(
        'hand-eye', hand_eye, 'scanner on the arm of a robot, from profiles of a sphere',
        ('--radius', 15.0, 'of the sphere (15)', 'MM'), ('--noise', 0.05, 'uncertainty of a point (0.05)', 'MM'),
        ('--mounted', (60.0, 0.0, 120.0, 0.0, 0.0, 90.0),
         'scanner on the torch as mounted, mm and degrees (60 0 120 0 0 90): where the search begins',
         (*axes, 'ROLL', 'PITCH', 'YAW')),
        FILE, *ROBOT, epilog=EYE,
    )  # fmt: skip


def robot_tcp(args: argparse.Namespace, graph: Graph) -> int:
    """Tip of the tool. EvidenceError where the touches do not tell it."""
    import numpy as np

    from . import outcome, pictures_robot, robot_evidence, robot_fit

    text = args.file.read_text(errors='replace')
    with _of_file(args.file):
        found = robot_fit.tool(robot_evidence.touches(text, _robot(args)), args.touch * 1e-3)
    told = np.array(args.told) * 1e-3
    result = outcome.of_tool(found, told)
    notes = ['tool of the controller, mm: ' + ' '.join(f'{v * 1e3:.3f}' for v in found.tip)]
    return keep(folder(args, graph), result, notes, [pictures_robot.touches(found)])


def hand_eye(args: argparse.Namespace, graph: Graph) -> int:
    """Scanner on the arm. EvidenceError where the profiles do not tell it."""
    import numpy as np

    from waam_robot.frames import pose_from_wpr
    from waam_robot.station import Station

    from . import outcome, pictures_robot, robot_evidence, robot_fit

    text = args.file.read_text(errors='replace')
    station = Station()
    mounted = pose_from_wpr(np.array(args.mounted[:3]) * 1e-3, np.radians(args.mounted[3:]))
    with _of_file(args.file):
        seen = robot_evidence.profiles(text, _robot(args))
        found = robot_fit.hand_eye(
            seen, args.radius * 1e-3, station.on_flange(mounted), args.noise * 1e-3
        )
    on_torch = station.on_torch(found.scanner)
    result = outcome.of_hand_eye(found, on_torch, mounted)
    notes = scan_parameters(on_torch)
    return keep(folder(args, graph), result, notes, [pictures_robot.profiles(found)])


@contextmanager
def _of_file(file: Path) -> Iterator[None]:
    """Poor evidence is told with the name of its file."""
    from .evidence import EvidenceError

    try:
        yield
    except EvidenceError as e:
        raise EvidenceError(f'{file}: {e}') from None


def scan_parameters(on_torch: np.ndarray) -> list[str]:
    """Parameters of scan_fusion for the scanner (4, 4) on the torch."""
    from waam_robot.frames import wpr

    xyz = ', '.join(f'{v:.6f}' for v in on_torch[:3, 3])
    rpy = ', '.join(f'{v:.6f}' for v in wpr(on_torch))
    return [f'scan_fusion: mount_xyz: [{xyz}], mount_rpy: [{rpy}]']


def _robot(args: argparse.Namespace) -> Robot:
    import math

    from waam_robot.joints import Counting

    from .robot_evidence import Robot

    position, angle = args.accuracy
    if not (position > 0 and angle > 0):
        raise ValueError('--accuracy: wanted two positive numbers')
    counting = Counting(args.zero, args.coupled)
    return Robot(counting, position=position * 1e-3, angle=math.radians(angle))
