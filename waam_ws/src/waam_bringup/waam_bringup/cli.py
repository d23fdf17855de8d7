"""The waam command. Every verb imports what it needs when it runs, so that --help is quick."""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from waam_process.cli_renamed import keep_old_name
from waam_process.loop_mode import LOOP_MODES, LoopMode
from waam_process.operating import GANTRY, MACHINES, ROBOT
from waam_record.cli import Graph

from . import audited, calibrate, cli_relay, panel
from .cli_common import add_run, reader_is_gone, run_and_domain
from .cli_job import register_job
from .paths import CELL, jobs_dir
from .shop import places

if TYPE_CHECKING:
    from .graph import Settings

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
    'waam_scan',
    'waam_adapt',
    'waam_lab',
    'waam_record',
    'waam_replay',
    'waam_view',
    'waam_robot',
    'waam_archive',
    'waam_shop',
)


def _recorded_requests(folder: Path) -> list[Any]:
    """Requests of the correction server in a recorded job, for `waam train --from`."""
    return importlib.import_module('waam_replay.corrections').requests_of(folder)


TWO_WORDS = ('lab fit',)  # verbs of two words, whose first word is a verb of its own

# what a package needs of another one that it must not know
OPTIONS: dict[str, dict[str, Any]] = {
    'waam_adapt': {'read_requests': _recorded_requests},
    'waam_archive': {'jobs_dir': jobs_dir},
    'waam_record': {'graph': Graph(add_run, lambda args: run_and_domain(args)[1])},
    'waam_shop': {'places': places()},
}


def build_parser() -> argparse.ArgumentParser:
    """The whole command line; packages add their own verbs with `<package>.cli.register`."""
    parser = argparse.ArgumentParser(
        prog='waam',
        description='Closed-loop wire-arc additive manufacturing: scan, correct, deposit, layer by layer.',
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest='command', metavar='COMMAND', required=True)
    _register_graph(commands)
    register_job(commands)
    _register_demo(commands)
    panel.register(commands)
    calibrate.register(commands)
    importlib.import_module('waam_plan.cli').register(commands, _draw_plan, _check_robot)
    for package in PACKAGES:
        importlib.import_module(f'{package}.cli').register(commands, **OPTIONS.get(package, {}))
    return parser


def _draw_plan(stored: Path, target: Path) -> None:
    """`waam plan --rerun`: planner and viewer meet here and nowhere else. Raises ValueError without rerun."""
    try:
        from waam_view.plan_scene import write_recording
    except ImportError as e:
        raise ValueError(f'--rerun needs waam_view and rerun ({e})') from None
    write_recording(stored, target)


def _check_robot(
    plan: Any, urdf: Path | None, turning: bool, out: Path | None, files: list[Path]
) -> None:
    """`waam plan --machine robot`: planner and laboratory meet here. Raises ValueError where the robot cannot."""
    importlib.import_module('waam_lab.cli_robot_check').check_robot(plan, urdf, turning, out, files)


def _register_graph(commands: argparse._SubParsersAction) -> None:
    p = commands.add_parser('up', help='start the graph and return when every node answers')
    add_run(p, '--name')
    _add_up(p)
    p.set_defaults(run_command=cmd_up)
    p = commands.add_parser(
        'stop', help='stop the graph; a running job is aborted with a safe end of the arc'
    )
    add_run(p, '--name')
    p.set_defaults(run_command=cmd_stop)
    p = commands.add_parser('status', help='what is up, what the machine and the job do')
    add_run(p, '--name')
    p.set_defaults(run_command=cmd_status)
    cli_relay.register(commands)


def _add_up(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        '--port',
        default='',
        help='serial port of a real controller; without it the cell is simulated',
    )
    p.add_argument(
        '--machine',
        choices=MACHINES,
        default=GANTRY,
        help='what moves the torch: the gantry (default), or a six-axis arm before a positioner, whose simulated cell '
        'keeps step with the wall clock',
    )
    p.add_argument(
        '--urdf',
        type=Path,
        metavar='FILE',
        help='with --machine robot: another arm, for bridge and simulated cell (waam_robot_bridge/README.md)',
    )
    p.add_argument(
        '--rate',
        type=float,
        default=0.0,
        help='simulated seconds per second at most; 0 = as fast as the nodes keep up (default), 1 = real time',
    )
    p.add_argument(
        '--seed', type=int, default=1, help='seed of everything random in the simulated cell'
    )
    p.add_argument(
        '--foreground', action='store_true', help='stay and print; Ctrl-C stops the graph'
    )
    p.add_argument(
        '--without',
        action='append',
        default=[],
        metavar='NODE',
        help='leave a node out (repeatable)',
    )
    _add_params_file(p)
    p.add_argument('--timeout', type=float, default=60.0, help='longest wait for readiness, s')
    p.add_argument(
        '--hang-timeout',
        type=float,
        default=15.0,
        metavar='S',
        help='a node that hangs for so long while no job runs is started again (default 15; 0 = never)',
    )
    _add_up_ports(p)


def _add_params_file(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        '--params-file',
        '--cell-file',
        dest='params_file',
        action='append',
        default=[],
        type=Path,
        help='ROS parameter file for all nodes (repeatable)',
    )


def _params_files(args: argparse.Namespace) -> tuple[Path, ...]:
    """ValueError for one that is missing."""
    files = tuple(f.resolve() for f in args.params_file)
    for file in files:
        if not file.exists():
            raise ValueError(f'--params-file {file}: no such file')
    return files


def _add_up_ports(p: argparse.ArgumentParser) -> None:
    for name, text in (
        ('grpc', 'dashboard: port for rerun viewers on 127.0.0.1 (0 = off)'),
        ('web', 'dashboard: port of the web viewer on 127.0.0.1 (0 = off)'),
        (
            'panel',
            "port of the operator's page on 127.0.0.1 (default 8600, any other one when that is taken)",
        ),
    ):
        p.add_argument(f'--{name}-port', type=int, default=0, help=text)


def _register_demo(commands: argparse._SubParsersAction) -> None:
    p = commands.add_parser(
        'demo',
        help='restore a worn part open loop and closed loop on the simulated cell, and compare',
    )
    p.add_argument('--seed', type=int, default=7)
    p.add_argument(
        '--machine',
        choices=MACHINES,
        default=GANTRY,
        help='what moves the torch: the gantry (default), or a six-axis arm before a positioner; then the closed loop '
        'runs on the gantry too, and the page shows both',
    )
    p.add_argument('--jobs', type=Path, help='where the folder goes (default: jobs/)')
    p.add_argument(
        '--layers', type=int, default=0, help='at most so many layers; 0 = as many as needed'
    )
    modes = p.add_argument(
        '--loop-modes',
        nargs='+',
        default=[LoopMode.OPEN_LOOP, LoopMode.CLOSED_LOOP],
        choices=LOOP_MODES,
        help='one run of each (default: open_loop closed_loop)',
    )
    keep_old_name(p, '--profiles', modes)
    p.add_argument('--rate', type=float, default=0.0)
    _add_params_file(p)
    p.add_argument(
        '--fresh',
        action='store_true',
        help='start without what former demos have taught (jobs/learned), and keep nothing',
    )
    p.set_defaults(run_command=cmd_demo)


# ---- commands ----------------------------------------------------------------------------------


def cmd_up(args: argparse.Namespace) -> int:
    """Starts a graph and prints where it is. ValueError for a parameter file that is missing."""
    from . import supervisor
    from .graph import Settings
    from .operate import free_port, panel_port, up

    run, domain = run_and_domain(args)
    settings = Settings(
        run=run,
        port=args.port,
        rate=args.rate,
        seed=args.seed,
        epoch_us=int(time.time()) * 1_000_000,
        grpc_port=args.grpc_port or (free_port() if args.web_port else 0),
        web_port=args.web_port,
        panel_port=args.panel_port or panel_port(),
        hang_timeout=args.hang_timeout,
        params_files=_params_files(args),
        without=tuple(args.without),
        machine=args.machine,
    )
    if args.urdf is not None:
        settings = _with_arm(settings, args.urdf)
    if args.foreground:
        return supervisor.run(settings, domain)
    passed = [*sys.argv[2:], '--run', str(run), '--domain', str(domain)]
    passed += ['--grpc-port', str(settings.grpc_port), '--panel-port', str(settings.panel_port)]
    state = up(settings, domain, args.timeout, passed)
    kind = 'simulated cell' if state.simulated else f'controller on {state.port}'
    print(
        f'up: {len(state.nodes)} processes, {kind}, ROS_DOMAIN_ID={state.domain}, logs in {run}/logs'
    )
    if state.panel_url:
        print(f'panel: {state.panel_url}')
    if state.web_url:
        print(f'dashboard: {state.web_url}')
    return 0


def _with_arm(settings: Settings, urdf: Path) -> Settings:
    """`waam up --urdf`: what the file says goes before the parameter files. Raises ValueError where it says nothing
    that can be used."""
    if settings.machine != ROBOT:
        raise ValueError('--urdf belongs to --machine robot')
    laboratory = importlib.import_module('waam_lab.robot.urdf_settings')
    given = list(settings.params_files)
    made = laboratory.parameter_file(urdf, given, settings.run / 'urdf.yaml')
    return replace(settings, params_files=(made, *given))


def cmd_stop(args: argparse.Namespace) -> int:
    """Status 0 also when nothing was up."""
    from .operate import stop

    run, _ = run_and_domain(args)
    print('stopped' if stop(run) else 'no graph is up')
    return 0


def cmd_status(args: argparse.Namespace) -> int:
    """Status 1 when a process of the graph has ended. ClientError when no graph is up."""
    from .operate import require_up
    from .status import print_status

    run, domain = run_and_domain(args)
    return print_status(run, require_up(run), domain)


def cmd_demo(args: argparse.Namespace) -> int:
    """Exit status: 0 when all jobs were done, whatever their verdict. ValueError for a missing parameter file."""
    from .demo import run_demo

    return run_demo(args, _params_files(args))


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
        audited.record(args)
        status: int = args.run_command(args)
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
