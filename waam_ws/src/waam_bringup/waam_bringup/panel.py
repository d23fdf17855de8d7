"""`waam panel`: the operator's page of the running graph."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

from waam_node.stop_socket import NAME
from waam_process.cli_options import Verbs, add_verb

from .cli_common import add_cell
from .run_state import RunState

_EXAMPLES = """examples:
  waam panel                    prints the address of the page of the graph that is up
  waam panel --open             and opens it in the browser
  waam panel --name cell2       that of another cell; all cells at a glance: /cells
  waam panel --port 8700        serves another one (also when the panel of the graph has died)
  waam token create "tablet at cell 3" --role operate
  waam panel --bind 0.0.0.0 --port 8600 --host cell-3.local --tls-cert cell-3.pem --tls-key cell-3.key
                                for a tablet: behind tokens and TLS, asked for as https://cell-3.local:8600/

The page is served on this machine only unless --bind says otherwise; then it needs tokens (waam token create) and a
certificate: that of your site, or one of your own (docs/cells.md). With --token-file it asks for tokens here, too."""


def register(commands: Verbs) -> None:
    """Adds the verb `panel`."""
    p = add_verb(
        commands, 'panel', "the operator's page: where it is, or serve one",
        ('--run', Path, 'folder of the running graph (default: jobs/.run)'),
        ('--open', False, 'open the page in the browser'), ('--port', 0, 'serve one here, until Ctrl-C'),
        ('--bind', '127.0.0.1', 'address to listen on (default 127.0.0.1)'),
        ('--token-file', Path, 'file of tokens (default: none on this machine, that of waam token create for any other '
         '--bind)'),
        ('--tls-cert', Path, 'certificate with its chain, PEM; needed for any other --bind'),
        ('--tls-key', Path, 'its key, PEM, readable by you only'),
        ('--host', [], 'name of this machine in the address'), epilog=_EXAMPLES,
    )  # fmt: skip
    add_cell(p, '--name')
    p.set_defaults(run_command=_panel)


def serves(args: argparse.Namespace) -> bool:
    """Whether a page of its own is asked for, and not the address of the one that is there."""
    return bool(args.port or args.bind != '127.0.0.1' or args.token_file or args.tls_cert)


def _panel(args: argparse.Namespace) -> int:
    from .operate import require_up
    from .paths import run_dir

    access = _access(args)
    run = (args.run or run_dir()).resolve()
    state = require_up(run)
    alive = 'panel' in state.nodes and 'panel' not in state.dead_nodes
    if alive and state.panel_url and not serves(args):
        print(state.panel_url)
        _open(args, state.panel_url)
        return 0
    return _serve(args, run, state, access)


def _start_lane(
    args: argparse.Namespace, socket: Path, port: int, second: int, access: dict[str, str]
) -> None:
    """The second way for STOP, with the rules of the page; it ends with this process."""
    from .graph import STOP_LANE, executable

    options = {
        'socket': socket, 'port': second, 'page-port': port, 'bind': args.bind, 'hosts': ','.join(args.host),
        'ends-with': os.getpid(), **{k.replace('_', '-'): v for k, v in access.items()},
    }  # fmt: skip
    words = [f'--{name}={value}' for name, value in options.items()]
    subprocess.Popen([str(executable('waam_panel', STOP_LANE)), *words], stdin=subprocess.DEVNULL)


def _open(args: argparse.Namespace, url: str) -> None:
    if args.open:
        import webbrowser

        webbrowser.open(url)


def _access(args: argparse.Namespace) -> dict[str, str]:
    """Parameters of tokens and TLS, checked before ROS is loaded. ValueError that says what is missing."""
    from waam_panel.security import is_local, open_tokens, tls_context
    from waam_shop.shop_folder import TOKENS

    from .paths import shop_dir

    tokens = args.token_file
    if not tokens and not is_local(args.bind) and (shop_dir() / TOKENS).is_file():
        tokens = shop_dir() / TOKENS
    files = {'token_file': tokens, 'tls_cert': args.tls_cert, 'tls_key': args.tls_key}
    texts = {k: str(Path(v).resolve()) if v else '' for k, v in files.items()}
    tls = tls_context(texts['tls_cert'], texts['tls_key'])
    open_tokens(texts['token_file'], args.bind, tls is not None)
    return texts


def _serve(args: argparse.Namespace, run: Path, state: RunState, access: dict[str, str]) -> int:
    """Runs the node in this process, on the domain of the graph."""
    from waam_panel.panel_node import main

    from .graph import commission_words
    from .operate import panel_port, stop_port
    from .paths import calibrations_dir, cell_name, jobs_dir, share, shop_dir

    port = args.port or panel_port()
    second, socket = stop_port(port, args.bind), run / NAME
    os.environ['ROS_DOMAIN_ID'] = str(state.domain)
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    folders = [str(jobs_dir() / 'parts'), str(share('waam_bringup') / 'parts')]
    values = {
        'bind': args.bind, 'port': port, 'jobs_dir': str(jobs_dir()), 'part_folders': folders,
        'shop_dir': str(shop_dir()), 'calibrations_dir': str(calibrations_dir()), 'cell': cell_name(),
        'run_dir': str(run), 'use_sim_time': state.simulated, 'stop_port': second,
        'stop_socket': str(socket), 'commission': commission_words(run), **access,
    }  # fmt: skip
    if args.host:
        values['allowed_hosts'] = ','.join(args.host)
    parameters = [x for k, v in values.items() for x in ('-p', f'{k}:={json.dumps(v)}')]
    _start_lane(args, socket, port, second, access)
    sys.argv = ['panel', '--ros-args', '-r', '__node:=panel_2', *parameters]
    name = args.host[0] if args.host else '127.0.0.1'
    scheme = 'https' if args.tls_cert else 'http'
    print(f'{scheme}://{name}:{port}/\nCtrl-C ends.', flush=True)
    _open(args, f'{scheme}://127.0.0.1:{port}/')
    main()
    return 0
