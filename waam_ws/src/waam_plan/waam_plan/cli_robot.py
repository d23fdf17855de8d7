"""Programs for robots on the command line: their options, files and checks."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from waam_process.operating import ROBOT

if TYPE_CHECKING:  # the planner is loaded only when a verb needs it
    from .plan import Plan
    from .robot.cell import RobotCell
    from .settings import PlanSettings

POSTS = ('fanuc', 'kuka', 'abb')
MAX_BYTES = 1_000_000


class Writer(Protocol):
    """Plan to files."""

    def __call__(
        self, plan: Plan, name: str = 'WAAM', cell: RobotCell | None = None, tolerance: float = ...
    ) -> dict[str, str]: ...


CELL_HELP = (
    'of a gantry: its cell file says how far it reaches and where the work zero is (default: '
    '$WAAM_CELL, or cell)'
)


class _Cell(argparse.Action):
    """--cell NAME; a file is that of a robot program, as this option once was."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        if '.' not in values and '/' not in values:
            namespace.cell = values
            return
        print(f'{option_string} FILE is now called --robot-cell', file=sys.stderr)
        namespace.robot_cell = Path(values)


def add_robot(p: argparse.ArgumentParser) -> None:
    """Options that belong to a robot and its program."""
    p.add_argument(
        '--tilt',
        type=float,
        metavar='DEG',
        help='of --machine robot: the positioner tilts the part by so much towards the robot, so that what leans to +x '
        'grows upwards; for overhangs beyond 45 degrees',
    )
    p.add_argument(
        '--urdf',
        type=Path,
        metavar='FILE',
        help='of --machine robot: another arm, as that of `waam up` and `waam lab` (waam_robot_bridge/README.md)',
    )
    p.add_argument(
        '--turning',
        action='store_true',
        help='of --machine robot: choose how the positioner turns the part while the torch goes, so that the arm stays '
        'away from its limits; with --out also robot.yaml for `waam up --machine robot --params-file`, and cell.yaml '
        'for programs (--post, --robot-cell)',
    )
    p.add_argument(
        '--params-file',
        action='append',
        default=[],
        type=Path,
        metavar='FILE',
        help='of --machine robot: parameters of its bridge, as for `waam up`: its box, where it stands, its drives '
        '(repeatable)',
    )
    p.add_argument(
        '--clamp',
        action='store_true',
        help='of --tilt: the part is held by a clamp at the work zero, over level ground, not on the faceplate',
    )
    p.add_argument('--cell', action=_Cell, metavar='NAME', help=CELL_HELP)
    p.add_argument(
        '--robot-cell',
        type=Path,
        metavar='YAML',
        help='of a robot program: positioner, frames, outputs, arc data (fields in waam_plan/README.md)',
    )
    p.add_argument(
        '--positioner',
        choices=('none', 'hold', 'turn', 'place'),
        help='of a robot: no external axes (default), axes that stand still, axes that follow the bead with a level '
        'torch, or a turn by where the torch is (`turning` of the cell file); overrides the cell file',
    )
    p.add_argument(
        '--corner',
        type=float,
        metavar='MM',
        help='of a robot: how far it may leave the path where two moves meet, default 0.006; more = faster corners',
    )


def check_arm(args: argparse.Namespace) -> None:
    """ValueError where options of a robot are given for another machine, or contradict each other."""
    for name in ('urdf', 'turning', 'params_file'):
        if getattr(args, name) and args.machine != ROBOT:
            raise ValueError(f'--{name.replace("_", "-")} belongs to --machine robot')
    if args.cell and args.machine == ROBOT:
        raise ValueError('--cell is the file of a gantry: not with --machine robot')
    wanted = [n for n in ('robot_cell', 'positioner', 'corner') if getattr(args, n) is not None]
    if args.post not in POSTS and wanted:
        raise ValueError(f'--{wanted[0].replace("_", "-")} belongs to --post {" | ".join(POSTS)}')
    if args.post in POSTS and not args.out:
        raise ValueError(f'--post {args.post} needs --out DIR: without it no program is written')
    if args.turning and (args.urdf or args.tilt):
        raise ValueError(
            '--turning is for a level part before the M-20iB/25: not with --urdf or --tilt'
        )


def box(args: argparse.Namespace) -> dict[str, Any]:
    """Settings for the box of the robot in the parameter files: its upper corner, the work zero being where it is.
    ValueError for a file that cannot be read."""
    from .settings import PlanSettings

    found: dict[str, Any] = {}
    for file in args.params_file:
        high = _work_high(file)
        if high is not None:
            low = PlanSettings().machine_min  # of the work zero in the box, turned round
            found['machine_max'] = tuple(a + b for a, b in zip(high, low, strict=True))
    return found


def _work_high(file: Path) -> tuple[float, ...] | None:
    """m, None where the file says nothing about it."""
    import yaml

    try:
        data = yaml.safe_load(file.read_bytes()[:MAX_BYTES])
        blocks = [
            data[key]['ros__parameters']
            for key in ('/**', '/**/bridge', '/bridge', 'bridge')
            if key in data
        ]
        high = next((b['work_high'] for b in blocks[::-1] if 'work_high' in b), None)
    except OSError as e:
        raise ValueError(f'--params-file {file}: {e.strerror}') from None
    except yaml.YAMLError as e:
        raise ValueError(f'--params-file {file}: no YAML ({" ".join(str(e).split())})') from None
    except (KeyError, TypeError, AttributeError):
        return None
    if high is None:
        return None
    if not isinstance(high, list) or len(high) != 3:
        raise ValueError(f'--params-file {file}: work_high is {high!r}, wanted are three numbers')
    return tuple(map(float, high))


def check_tilt(args: argparse.Namespace, settings: PlanSettings) -> None:
    """ValueError where the part cannot be tilted."""
    from . import cli_program

    if args.machine != ROBOT:
        raise ValueError('--tilt needs --machine robot: no other machine tilts the part')
    if cli_program.is_program(args) or args.level is not None or args.zone:
        raise ValueError('--tilt belongs to a mesh, not to a program, --level or --zone')
    if not args.as_found and not settings.clamp:
        raise ValueError(
            '--tilt of a build has no level ground: give what stands there as --as-found, or --clamp where the lowest '
            'face of the tilted part begins on a level one'
        )


def write_robot(plan: Plan, args: argparse.Namespace) -> None:
    """Writes the files and tells what was saved. Raises ValueError."""
    from waam_plan.gcode.compact import fragments, saving
    from waam_plan.robot.motion import TOLERANCE

    cell = load_cell(args)
    tolerance = TOLERANCE if args.tolerance is None else args.tolerance * 1e-3
    files = writer(args.post)(plan, cell=cell, tolerance=tolerance)
    for name, text in files.items():
        (args.out / name).write_text(text)
    s = saving(plan, fragments(plan, tolerance))
    kinds = ', '.join(sorted({Path(name).suffix for name in files}))
    print(
        f'{len(files)} files ({kinds}); {s.after} points instead of {s.before}, {s.share:.0%} saved'
    )


def load_cell(args: argparse.Namespace) -> RobotCell:
    """The cell of --cell, with what the other options say. Raises RobotProgramError (a ValueError)."""
    from waam_plan.robot.cell import RobotCell, cell_of
    from waam_plan.robot.motion import RobotProgramError

    cell = RobotCell()
    if args.robot_cell:
        import yaml

        try:
            data = yaml.safe_load(args.robot_cell.read_bytes()[:MAX_BYTES])
        except yaml.YAMLError as e:
            raise RobotProgramError(
                f'{args.robot_cell}: no YAML ({" ".join(str(e).split())})'
            ) from None
        cell = cell_of(data, str(args.robot_cell))
    if args.positioner:
        cell = replace(cell, positioner=args.positioner)
    if args.corner is not None:
        cell = replace(cell, corner=args.corner * 1e-3)
    return cell


def writer(post: str) -> Writer:
    """Of one of POSTS."""
    from waam_plan.robot.abb import write_rapid
    from waam_plan.robot.fanuc import write_ls
    from waam_plan.robot.kuka import write_krl

    return {'fanuc': write_ls, 'kuka': write_krl, 'abb': write_rapid}[post]
