"""What the command line says of part and program, the same for `waam job run` and `waam lab`."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from waam_plan import cli_shaft
from waam_plan.cli_program import PART_HELP as PART_HELP
from waam_plan.cli_program import add_program as add_program
from waam_plan.cli_shaft import add_shaft as add_shaft
from waam_plan.settings import FINISHES as FINISHES
from waam_process.loop_mode import LOOP_MODES, LoopMode
from waam_process.segment import Point

FINISH_HELP = (
    'of a restoration: as-laid (default) within the tolerance; machined: nothing below nominal after machining, the '
    'allowance chosen by the forecast unless --allowance gives it'
)


@dataclass(frozen=True)
class Asked:
    """What is laid and how, in the words of JobGoal."""

    part: Path | None  # None: a program without a nominal part
    program: Path | None
    dialect: str
    shift: Point  # m
    mode: str
    loop_mode: str

    def goal_fields(self) -> dict[str, Any]:
        """For JobGoal, with whole paths."""
        return {
            'part': self.part.resolve() if self.part else Path(''),
            'program': self.program.resolve() if self.program else None,
            'dialect': self.dialect,
            'program_shift': self.shift,
            'mode': self.mode,
            'loop_mode': self.loop_mode,
        }


def add_loop_mode(p: argparse.ArgumentParser) -> None:
    """The option --loop-mode."""
    p.add_argument(
        '--loop-mode',
        choices=LOOP_MODES,
        help='default: closed_loop; for a program without --nominal monitor',
    )


def with_finish(args: argparse.Namespace) -> tuple[str, ...]:
    """--finish as a setting of the planner."""
    return (f'finish={args.finish}',) if getattr(args, 'finish', None) else ()


def with_shaft(args: argparse.Namespace) -> tuple[str, ...]:
    """--shaft and --ends as settings of the planner. ValueError for what does not go with them."""
    return tuple(f'{k}={v!r}' for k, v in cli_shaft.settings_of(args).items())


def asked_of(args: argparse.Namespace, default_mode: str = 'restore') -> Asked:
    """A program is told from a part by the name of its file. It is built on a plate unless a worn part is there, and
    without a nominal part it is only watched. ValueError for options that belong to the other."""
    from waam_plan.import_gcode.files import is_program, shipped

    nominal, dialect = getattr(args, 'nominal', None), getattr(args, 'dialect', '')
    x, y, z = getattr(args, 'shift', (0.0, 0.0, 0.0))
    worn = getattr(args, 'as_found', None)
    if is_program(args.part):
        if dialect and dialect not in shipped():
            dialect = str(Path(dialect).resolve())
        mode = args.mode or ('restore' if worn else 'build')
        loop_mode = args.loop_mode or (LoopMode.CLOSED_LOOP if nominal else LoopMode.MONITOR)
        return Asked(
            nominal, args.part, dialect, (x * 1e-3, y * 1e-3, z * 1e-3), mode, str(loop_mode)
        )
    if nominal or dialect or any((x, y, z)):
        raise ValueError(
            f'--nominal, --dialect and --shift belong to a program, not to {args.part}'
        )
    loop_mode = args.loop_mode or LoopMode.CLOSED_LOOP
    return Asked(args.part, None, '', (0.0, 0.0, 0.0), args.mode or default_mode, str(loop_mode))
