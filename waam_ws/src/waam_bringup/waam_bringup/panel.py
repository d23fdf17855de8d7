"""`waam panel`: the operator's page of the running graph."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

from .run_state import RunState

_EXAMPLES = """examples:
  waam panel                    prints the address of the page of the graph that is up
  waam panel --open             and opens it in the browser
  waam panel --port 8700        serves another one (also when the panel of the graph has died)
  waam panel --bind 0.0.0.0 --port 8600 --token-file ~/.waam_token --host cell-3.local
                                for a tablet: behind a token, asked for as http://cell-3.local:8600/

The page is served on this machine only unless --bind says otherwise; then --token-file is required, with a file that
only you can read:  (umask 077; openssl rand -hex 24 > ~/.waam_token)
Traffic is not encrypted: across anything but a cable of your own put a TLS proxy in front."""


def register(commands: argparse._SubParsersAction) -> None:
    """Adds the verb `panel`."""
    p = commands.add_parser(
        'panel', help="the operator's page: where it is, or serve one",
        epilog=_EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    p.add_argument('--run', type=Path, help='folder of the running graph (default: jobs/.run)')
    p.add_argument('--open', action='store_true', help='open the page in the browser')
    p.add_argument('--port', type=int, default=0, help='serve one here, until Ctrl-C')
    p.add_argument('--bind', default='127.0.0.1', help='address to listen on (default 127.0.0.1)')
    p.add_argument('--token-file', type=Path, help='needed for any other --bind')
    p.add_argument(
        '--host', action='append', default=[], help='name of this machine in the address'
    )
    p.set_defaults(run_command=_panel)


def _panel(args: argparse.Namespace) -> int:
    from .operate import require_up
    from .paths import run_dir

    run = (args.run or run_dir()).resolve()
    state = require_up(run)
    alive = 'panel' in state.nodes and 'panel' not in state.dead_nodes
    asked = args.port or args.bind != '127.0.0.1' or args.token_file
    if alive and state.panel_url and not asked:
        print(state.panel_url)
        _open(args, state.panel_url)
        return 0
    return _serve(args, state)


def _open(args: argparse.Namespace, url: str) -> None:
    if args.open:
        import webbrowser

        webbrowser.open(url)


def _serve(args: argparse.Namespace, state: RunState) -> int:
    """Runs the node in this process, on the domain of the graph."""
    from waam_panel.panel_node import main

    from .operate import panel_port
    from .paths import jobs_dir, share

    port = args.port or panel_port()
    os.environ['ROS_DOMAIN_ID'] = str(state.domain)
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    folders = [str(jobs_dir() / 'parts'), str(share('waam_bringup') / 'parts')]
    values = {
        'bind': args.bind, 'port': port, 'jobs_dir': str(jobs_dir()), 'part_folders': folders,
        'token_file': str(args.token_file.resolve()) if args.token_file else '', 'use_sim_time': state.simulated,
    }  # fmt: skip
    if args.host:
        values['allowed_hosts'] = ','.join(args.host)
    parameters = [x for k, v in values.items() for x in ('-p', f'{k}:={json.dumps(v)}')]
    sys.argv = ['panel', '--ros-args', '-r', '__node:=panel_2', *parameters]
    name = args.host[0] if args.host else '127.0.0.1'
    print(f'http://{name}:{port}/\nCtrl-C ends.', flush=True)
    _open(args, f'http://127.0.0.1:{port}/')
    main()
    return 0
