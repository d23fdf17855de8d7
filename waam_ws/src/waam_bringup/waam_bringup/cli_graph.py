"""`waam up`, `stop` and `status`: their options, and what they do."""

from __future__ import annotations

import argparse
import importlib
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from waam_process.cli_options import Options, Verbs, add_verb
from waam_process.operating import DEFAULT_PRESET, GANTRY, MACHINES, PRESETS, ROBOT

from .cli_common import add_run, run_and_domain

if TYPE_CHECKING:
    from .graph import Settings

UP: Options = (
    ('--port', '', 'serial port of a real controller (default: link.port of the cell file); without it the cell is '
     'simulated'),
    ('--simulated', False, 'no machine, whatever the cell file says: its axes, limits and work zero, simulated'),
    ('--pyrometer', '', "what measures the part's temperature on a real cell: 0-10V, 4-20mA or thermocouple at the "
     'controller, or serial:PORT, modbus:PORT, modbus:HOST:PORT, topic:NAME beside it', 'SOURCE'),
    ('--machine', GANTRY, 'what moves the torch: the gantry (default), or a six-axis arm before a positioner, whose '
     'simulated cell keeps step with the wall clock', None, {'choices': MACHINES}),
    ('--urdf', Path, 'with --machine robot: another arm, for bridge and simulated cell (waam_robot_bridge/README.md)',
     'FILE'),
    ('--rate', 0.0, 'simulated seconds per second at most; 0 = as fast as the nodes keep up (default), 1 = real time'),
    ('--seed', 1, 'seed of everything random in the simulated cell'),
    ('--machine-steps', (320.0, 320.0, 320.0), 'steps that a mm of the simulated gantry really takes (those of the '
     'bridge\'s parameters, else 320 each, as its controller has them at first)', ('X', 'Y', 'Z')),
    ('--foreground', False, 'stay and print; Ctrl-C stops the graph'),
    ('--without', [], 'leave a node out (repeatable)', 'NODE'),
    ('--hang-timeout', 15.0, 'a node that hangs for so long while no job runs is started again (default 15; 0 = never)',
     'S'),
    ('--grpc-port', 0, 'dashboard: port for rerun viewers on 127.0.0.1 (0 = off)'),
    ('--web-port', 0, 'dashboard: port of the web viewer on 127.0.0.1 (0 = off)'),
    ('--panel-port', 0, "port of the operator's page on 127.0.0.1 (default 8600, any other one when that is taken)"),
    ('--stop-port', 0, "port of the second way for the page's STOP (default: the one after that of the page)"),
)  # fmt: skip
SIMULATED: Options = (  # of every verb that starts a graph
    ('--params-file --cell-file', [], 'ROS parameter file for all nodes (repeatable)', None,
     {'dest': 'params_file', 'type': Path}),
    ('--preset', DEFAULT_PRESET, f'how rough the simulated cell is (default: {DEFAULT_PRESET}); what a parameter file '
     'says of it wins', None, {'choices': PRESETS}),
)  # fmt: skip
STATUS: Options = (('--json', False, 'for programs: one JSON object, null for what is not known'),)


def register(commands: Verbs) -> None:
    """Adds the verbs."""
    p = add_verb(
        commands, 'up', 'start the graph and return when every node answers', *UP, *SIMULATED
    )
    p.add_argument(
        '--settings-are-whole', action='store_true', help=argparse.SUPPRESS
    )  # nothing is read besides
    p.set_defaults(run_command=_up)
    add_run(p, '--name')
    text = 'stop the graph; a running job is aborted with a safe end of the arc'
    for name, run, told in (
        ('stop', _stop, text), ('status', status, 'what is up, what the machine and the job do'),
    ):  # fmt: skip
        p = add_verb(commands, name, told, *(STATUS if name == 'status' else ()))
        p.set_defaults(run_command=run)
        add_run(p, '--name')


def params_files(args: argparse.Namespace) -> tuple[Path, ...]:
    """ValueError for one that is missing."""
    files = tuple(f.resolve() for f in args.params_file)
    for file in files:
        if not file.exists():
            raise ValueError(f'--params-file {file}: no such file')
    return files


def settings_of(args: argparse.Namespace, run: Path) -> Settings:
    """Of the arguments of `waam up`. ValueError for a parameter file that is missing, or a URDF that cannot be used."""
    from .graph import Settings
    from .operate import free_port, panel_port, stop_port

    page = args.panel_port or panel_port()
    settings = Settings(
        run=run,
        port=args.port,
        pyrometer=args.pyrometer,
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
    if not args.settings_are_whole:
        settings = _with_cell(settings, args)
    if args.foreground:
        return supervisor.run(settings, domain)
    state = up(settings, domain)
    kind = f'simulated cell ({state.preset})' if state.simulated else f'controller on {state.port}'
    print(
        f'up: {len(state.nodes)} processes, {kind}, ROS_DOMAIN_ID={state.domain}, logs in {run}/logs'
    )
    if state.panel_url:
        print(f'panel: {state.panel_url}')
    if state.web_url:
        print(f'dashboard: {state.web_url}')
    return 0


def _with_cell(settings: Settings, args: argparse.Namespace) -> Settings:
    """With the cell file; prints what it adds. ValueError for --simulated with a port, and for a wrong file."""
    from .cell_graph import apply

    if args.simulated and args.port:
        raise ValueError('--simulated and --port contradict each other')
    applied = apply(settings, args.simulated)
    for text in applied.said:
        print(text)
    return applied.settings


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


def status(args: argparse.Namespace) -> int:
    """`waam status`, `waam job status`. Exit status 1 when a process of the graph has ended. ClientError when no graph
    is up."""
    from .operate import require_up
    from .status import print_status

    run, domain = run_and_domain(args)
    return print_status(run, require_up(run), domain, args.json, args.command == 'job')
