"""The waam command. Every verb imports what it needs when it runs, so that --help is quick."""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from pathlib import Path

EPILOG = """\
first steps:
  make demo                                  the whole thing, simulated, in a few minutes
  waam up                                    simulated cell (real: waam up --port /dev/serial/by-id/...)
  waam job run part.stl --as-found worn.stl  restore a worn part
  waam status                                what is going on
  waam stop                                  end everything

The firmware and this software do not replace the hardware safety chain
(emergency stop, interlocks, fume extraction, eye protection).
"""
PACKAGES = ('waam_plan', 'waam_scan', 'waam_record', 'waam_view')


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
    _register_job(commands)
    _register_demo(commands)
    for package in PACKAGES:
        importlib.import_module(f'{package}.cli').register(commands)
    return parser


def _add_run(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        '--run', type=Path, help='folder of the running graph (default: jobs/.run or $WAAM_RUN)'
    )
    p.add_argument(
        '--domain', type=int, help='ROS_DOMAIN_ID (default: from the environment or the folder)'
    )


def _register_graph(commands) -> None:
    p = commands.add_parser('up', help='start the graph and return when every node answers')
    _add_run(p)
    p.add_argument(
        '--port',
        default='',
        help='serial port of a real controller; without it the cell is simulated',
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
    p.add_argument(
        '--params-file',
        action='append',
        default=[],
        type=Path,
        help='ROS parameter file for all nodes (repeatable)',
    )
    p.add_argument(
        '--grpc-port',
        type=int,
        default=0,
        help='dashboard: port for rerun viewers on 127.0.0.1 (0 = off)',
    )
    p.add_argument(
        '--web-port',
        type=int,
        default=0,
        help='dashboard: port of the web viewer on 127.0.0.1 (0 = off)',
    )
    p.add_argument('--timeout', type=float, default=60.0, help='longest wait for readiness, s')
    p.set_defaults(run_command=cmd_up)
    p = commands.add_parser(
        'stop', help='stop the graph; a running job is aborted with a safe end of the arc'
    )
    _add_run(p)
    p.set_defaults(run_command=cmd_stop)
    p = commands.add_parser('status', help='what is up, what the machine and the job do')
    _add_run(p)
    p.set_defaults(run_command=cmd_status)


def _register_job(commands) -> None:
    job = commands.add_parser('job', help='run and steer jobs').add_subparsers(
        dest='verb', metavar='VERB', required=True
    )
    p = job.add_parser(
        'run',
        help='run a job on the graph that is up and follow it',
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog='examples:\n'
        '  waam job run jaw_nominal.stl --as-found jaw_worn.stl --material er70s-6\n'
        '  waam job run vase.stl --mode build --layers 3 --profile monitor\n\n'
        'exit status: 0 done, 1 the job failed, 2 it was refused, 130 cancelled with Ctrl-C',
    )
    _add_run(p)
    p.add_argument('part', type=Path, help='nominal part: STL or PLY')
    p.add_argument(
        '--material', default='er70s-6', help='key of the material table (default er70s-6)'
    )
    p.add_argument(
        '--layers', type=int, default=0, help='at most so many layers; 0 = as many as needed'
    )
    p.add_argument(
        '--profile', choices=('open_loop', 'monitor', 'closed_loop'), default='closed_loop'
    )
    p.add_argument(
        '--mode',
        choices=('restore', 'build'),
        default='restore',
        help='restore: nominal minus scan; build: onto a flat plate',
    )
    p.add_argument(
        '--as-found', type=Path, help='simulated cell: mesh of the worn part that lies on the table'
    )
    p.add_argument('--layer-height', type=float, default=0.0, metavar='MM')
    p.add_argument('--bead-width', type=float, default=0.0, metavar='MM')
    p.add_argument(
        '--k-gain',
        type=float,
        default=float('nan'),
        help='authority of the speed correction, 0..0.3',
    )
    p.add_argument('--tolerance', type=float, default=0.2, metavar='MM')
    p.add_argument(
        '--scale',
        type=float,
        default=1e-3,
        help='metres per unit of the file (default 0.001: millimetres)',
    )
    p.add_argument('--name', default='', help='short name in the folder of the job')
    p.add_argument('--jobs', type=Path, help='where job folders go (default: jobs/)')
    p.add_argument(
        '--note',
        action='append',
        default=[],
        metavar='KEY=VALUE',
        help='kept in job.yaml, such as wire_lot=4711',
    )
    p.set_defaults(run_command=cmd_job_run)
    for verb, text in (
        ('pause', 'hold the machine; the arc ends properly'),
        ('resume', 'go on'),
        ('abort', 'end the job; the arc ends, the queue is dropped'),
    ):
        p = job.add_parser(verb, help=text)
        _add_run(p)
        p.set_defaults(run_command=cmd_job_switch, verb=verb)


def _register_demo(commands) -> None:
    p = commands.add_parser(
        'demo',
        help='restore a worn part open loop and closed loop on the simulated cell, and compare',
    )
    p.add_argument('--seed', type=int, default=7)
    p.add_argument('--jobs', type=Path, help='where the folder goes (default: jobs/)')
    p.add_argument(
        '--layers', type=int, default=0, help='at most so many layers; 0 = as many as needed'
    )
    p.add_argument(
        '--profiles',
        nargs='+',
        default=['open_loop', 'closed_loop'],
        choices=('open_loop', 'monitor', 'closed_loop'),
    )
    p.add_argument('--rate', type=float, default=0.0)
    p.set_defaults(run_command=cmd_demo)


# ---- commands ----------------------------------------------------------------------------------


def _run_and_domain(args) -> tuple[Path, int]:
    from .operate import default_domain
    from .paths import run_dir
    from .run_state import load

    run = (args.run or run_dir()).resolve()
    state = load(run)
    if args.domain is not None:
        return run, args.domain
    return run, state.domain if state and state.alive else default_domain(run)


def cmd_up(args) -> int:
    from . import supervisor
    from .graph import Settings
    from .operate import free_port, up

    run, domain = _run_and_domain(args)
    settings = Settings(
        run=run,
        port=args.port,
        rate=args.rate,
        seed=args.seed,
        epoch_us=int(time.time()) * 1_000_000,
        grpc_port=args.grpc_port or (free_port() if args.web_port else 0),
        web_port=args.web_port,
        params_files=tuple(f.resolve() for f in args.params_file),
        without=tuple(args.without),
    )
    for file in settings.params_files:
        if not file.exists():
            raise ValueError(f'--params-file {file}: no such file')
    if args.foreground:
        return supervisor.run(settings, domain)
    passed = [*sys.argv[2:], '--run', str(run), '--domain', str(domain)]
    state = up(settings, domain, args.timeout, [*passed, '--grpc-port', str(settings.grpc_port)])
    kind = 'simulated cell' if state.simulated else f'controller on {state.port}'
    print(
        f'up: {len(state.nodes)} processes, {kind}, ROS_DOMAIN_ID={state.domain}, logs in {run}/logs'
    )
    if state.web_url:
        print(f'dashboard: {state.web_url}')
    return 0


def cmd_stop(args) -> int:
    from .operate import stop

    run, _ = _run_and_domain(args)
    print('stopped' if stop(run) else 'no graph is up')
    return 0


def cmd_status(args) -> int:
    from .operate import require_up
    from .status import print_status

    run, domain = _run_and_domain(args)
    return print_status(run, require_up(run), domain)


def cmd_job_run(args) -> int:
    from .jobs import run_job

    run, domain = _run_and_domain(args)
    return run_job(args, run, domain)


def cmd_job_switch(args) -> int:
    from .client import GraphClient
    from .operate import require_up

    run, domain = _run_and_domain(args)
    require_up(run)
    with GraphClient(domain) as client:
        client.trigger(f'job_sequencer/{args.verb}')
    print(f'{args.verb}: accepted')
    return 0


def cmd_demo(args) -> int:
    from .demo import run_demo

    return run_demo(args)


def main(argv: list[str] | None = None) -> int:
    """Errors of use print one line and give exit status 2."""
    from .client import ClientError

    args = build_parser().parse_args(argv)
    try:
        return (
            getattr(args, 'run_command', None)(args)
            if hasattr(args, 'run_command')
            else args.run(args)
        )
    except (ValueError, OSError, ClientError) as e:
        print(f'waam: error: {e}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


if __name__ == '__main__':
    sys.exit(main())
