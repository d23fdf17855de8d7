"""`waam up`, `stop` and `status`: their options, and what they do."""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from waam_process.operating import DEFAULT_PRESET, GANTRY, MACHINES, PRESETS, ROBOT

from . import cli_relay
from .cli_common import add_run, run_and_domain

if TYPE_CHECKING:
    from .graph import Settings


def register(commands: argparse._SubParsersAction) -> None:
    """Adds the verbs."""
    p = commands.add_parser('up', help='start the graph and return when every node answers')
    add_run(p, '--name')
    _add_up(p)
    p.set_defaults(run_command=_up)
    p = commands.add_parser(
        'stop', help='stop the graph; a running job is aborted with a safe end of the arc'
    )
    add_run(p, '--name')
    p.set_defaults(run_command=_stop)
    p = commands.add_parser('status', help='what is up, what the machine and the job do')
    add_run(p, '--name')
    p.set_defaults(run_command=_status)
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
        '--machine-steps', nargs=3, type=float, metavar=('X', 'Y', 'Z'), default=(320.0,) * 3,
        help='steps that a mm of the simulated gantry really takes (320 each, as its controller has them at first)',
    )  # fmt: skip
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
    add_params_file(p)
    add_preset(p)
    p.add_argument('--timeout', type=float, default=60.0, help='longest wait for readiness, s')
    p.add_argument(
        '--hang-timeout',
        type=float,
        default=15.0,
        metavar='S',
        help='a node that hangs for so long while no job runs is started again (default 15; 0 = never)',
    )
    _add_up_ports(p)


def add_params_file(p: argparse.ArgumentParser) -> None:
    """Option --params-file, for `params_files`."""
    p.add_argument(
        '--params-file',
        '--cell-file',
        dest='params_file',
        action='append',
        default=[],
        type=Path,
        help='ROS parameter file for all nodes (repeatable)',
    )


def add_preset(p: argparse.ArgumentParser) -> None:
    """Option --preset."""
    p.add_argument(
        '--preset',
        choices=PRESETS,
        default=DEFAULT_PRESET,
        help=f'how rough the simulated cell is (default: {DEFAULT_PRESET}); what a parameter file says of it wins',
    )


def params_files(args: argparse.Namespace) -> tuple[Path, ...]:
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
        (
            'stop',
            "port of the second way for the page's STOP (default: the one after that of the page)",
        ),
    ):
        p.add_argument(f'--{name}-port', type=int, default=0, help=text)


def settings_of(args: argparse.Namespace, run: Path) -> Settings:
    """Of the arguments of `waam up`. ValueError for a parameter file that is missing, or a URDF that cannot be used."""
    from .graph import Settings
    from .operate import free_port, panel_port, stop_port

    page = args.panel_port or panel_port()
    settings = Settings(
        run=run,
        port=args.port,
        rate=args.rate,
        seed=args.seed,
        machine_steps=tuple(args.machine_steps),
        epoch_us=int(time.time()) * 1_000_000,
        grpc_port=args.grpc_port or (free_port() if args.web_port else 0),
        web_port=args.web_port,
        panel_port=page,
        stop_port=args.stop_port or stop_port(page),
        hang_timeout=args.hang_timeout,
        params_files=params_files(args),
        without=tuple(args.without),
        machine=args.machine,
        preset=args.preset,
    )
    return settings if args.urdf is None else _with_arm(settings, args.urdf)


def _up(args: argparse.Namespace) -> int:
    """Starts a graph and prints where it is. ValueError for a parameter file that is missing."""
    from . import supervisor
    from .operate import up

    run, domain = run_and_domain(args)
    settings = settings_of(args, run)
    if args.foreground:
        return supervisor.run(settings, domain)
    passed = [*sys.argv[2:], '--run', str(run), '--domain', str(domain)]
    passed += ['--grpc-port', str(settings.grpc_port), '--panel-port', str(settings.panel_port)]
    passed += ['--stop-port', str(settings.stop_port)]
    state = up(settings, domain, args.timeout, passed)
    kind = f'simulated cell ({state.preset})' if state.simulated else f'controller on {state.port}'
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


def _stop(args: argparse.Namespace) -> int:
    """Status 0 also when nothing was up."""
    from .operate import stop

    run, _ = run_and_domain(args)
    print('stopped' if stop(run) else 'no graph is up')
    return 0


def _status(args: argparse.Namespace) -> int:
    """Status 1 when a process of the graph has ended. ClientError when no graph is up."""
    from .operate import require_up
    from .status import print_status

    run, domain = run_and_domain(args)
    return print_status(run, require_up(run), domain)
