"""The waam command. Every verb imports what it needs when it runs, so that --help is quick."""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
from importlib import metadata
from pathlib import Path
from types import FrameType
from typing import Any

from waam_process.cli_options import Verbs, add_verb
from waam_process.loop_mode import LOOP_MODES, LoopMode
from waam_process.operating import GANTRY, MACHINES
from waam_record.cli import Graph

from . import audited, calibrate, cli_cell, cli_commission, cli_graph, cli_ports, panel
from .cell_desk import laboratory, reach
from .cli_common import add_run, late, reader_is_gone, run_and_domain
from .cli_job import register_job
from .cli_parser import Grouped, Parser, register_completion
from .paths import CELL, jobs_dir
from .shop import places

EPILOG = """\
first steps:
  make demo                                  the whole thing, simulated, in a few minutes
  waam up                                    simulated cell (real: waam up --port /dev/serial/by-id/...)
  waam job run part.stl --as-found worn.stl  restore a worn part
  waam panel --open                          the operator's page in the browser
  waam status                                what is going on
  waam stop                                  end everything

The firmware and this software do not replace the hardware safety chain
(emergency stop, interlocks, fume extraction, eye protection).
"""
PACKAGES = (
    'waam_scan', 'waam_train', 'waam_lab', 'waam_record', 'waam_replay', 'waam_view', 'waam_robot', 'waam_archive',
    'waam_shop',
)  # fmt: skip
TWO_WORDS = ('lab fit',)  # verbs of two words, whose first word is a verb of its own

# what a package needs of another one that it must not know
OPTIONS: dict[str, dict[str, Any]] = {
    'waam_archive': {'jobs_dir': jobs_dir},
    'waam_lab': {'of_cell': laboratory, 'jobs_dir': jobs_dir},
    'waam_record': {'graph': Graph(add_run, lambda args: run_and_domain(args)[1])},
    'waam_shop': {'places': places()},
}


def build_parser() -> argparse.ArgumentParser:
    """The whole command line; packages add their own verbs with `<package>.cli.register`."""
    parser = Parser(
        prog='waam',
        description='Closed-loop wire-arc additive manufacturing: scan, correct, deposit, layer by layer.',
        epilog=EPILOG,
        formatter_class=Grouped,
    )
    parser.add_argument(
        '--version', action='version', version=f'waam {metadata.version("waam_bringup")}'
    )
    commands = parser.add_subparsers(
        dest='command', metavar='COMMAND', required=True, title='commands'
    )
    cli_graph.register(commands)
    register_job(commands)
    _register_demo(commands)
    panel.register(commands)
    calibrate.register(commands)
    cli_commission.register(commands)
    cli_cell.register(commands)
    cli_ports.register(commands)
    importlib.import_module('waam_plan.cli').register(commands, _check_robot, reach)
    for package in PACKAGES:
        importlib.import_module(f'{package}.cli').register(commands, **OPTIONS.get(package, {}))
    register_completion(commands, parser)
    return parser


def _check_robot(
    plan: Any, urdf: Path | None, turning: bool, out: Path | None, files: list[Path]
) -> None:
    """`waam plan --machine robot`: planner and laboratory meet here. Raises ValueError where the robot cannot."""
    importlib.import_module('waam_lab.cli_robot_check').check_robot(plan, urdf, turning, out, files)


def _register_demo(commands: Verbs) -> None:
    p = add_verb(
        commands, 'demo', 'restore a worn part open loop and closed loop on the simulated cell, and compare',
        ('--part', 'jaw', 'jaw (default): a crusher jaw, then a die insert that is machined; shaft: a worn shaft that '
         'turns in a chuck in place of the X axis', None, {'choices': ('jaw', 'shaft')}),
        ('--seed', 7, 'of everything random'),
        ('--machine', GANTRY, 'what moves the torch: the gantry (default), or a six-axis arm before a positioner; then '
         'the closed loop runs on the gantry too, and the page shows both', None, {'choices': MACHINES}),
        ('--jobs', Path, 'where the folder goes (default: jobs/)'),
        ('--layers', 0, 'at most so many layers; 0 = as many as needed'),
        ('--rate', 0.0, 'simulated seconds per second at most'), *cli_graph.SIMULATED,
        ('--fresh', False, 'start without what former demos have taught (jobs/learned), and keep nothing'),
    )  # fmt: skip
    p.add_argument(
        '--loop-modes', nargs='+', default=[LoopMode.OPEN_LOOP, LoopMode.CLOSED_LOOP], choices=LOOP_MODES,
        help='one run of each (default: open_loop closed_loop)',
    )  # fmt: skip
    p.set_defaults(run_command=late('demo', 'demo'))


def _terminated(number: int, _frame: FrameType | None) -> None:
    """Ends like Ctrl-C: whatever the command has started is stopped."""
    raise SystemExit(128 + number)


def joined(words: list[str]) -> list[str]:
    """A verb of two words as one."""
    both = ' '.join(words[:2])
    return [both, *words[2:]] if both in TWO_WORDS else words


def main(argv: list[str] | None = None) -> int:
    """Errors of use print one line and give exit status 2."""
    from .client import ClientError

    signal.signal(signal.SIGTERM, _terminated)
    before = os.environ.get(CELL)  # --cell sets it, for this command and what it starts
    try:
        args = build_parser().parse_args(joined(sys.argv[1:] if argv is None else argv))
        status = audited.carry_out(args)
        sys.stdout.flush()
        return status
    except (ValueError, OSError, ClientError) as e:
        if reader_is_gone(e):
            return 128 + signal.SIGPIPE
        print(f'waam: error: {e}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except NameError as e:  # Ctrl-C while a library was being loaded, whose own tidying then fails
        if not isinstance(e.__context__, KeyboardInterrupt):
            raise
        return 130
    finally:
        os.environ.pop(CELL, None)
        if before is not None:
            os.environ[CELL] = before


if __name__ == '__main__':
    sys.exit(main())
