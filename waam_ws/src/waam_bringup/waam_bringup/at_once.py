"""What `waam stop`, `waam job abort` and `waam job pause` do before anything else is loaded: one byte to the bridge.

Run by `./waam` as a file (`python3 -I -S at_once.py stop ...`), and by the installed command as a module. Standard
library only. What is not understood does nothing here: the command itself then says what is wrong with it.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping, Sequence

PATIENCE_S = 0.3  # for the answer of the bridge; the byte has been sent before
HELP = ('-h', '--help')
VALUES = ('--run', '--cell', '--name', '--domain')  # options of these verbs; all have a value
NAME = re.compile(r'[a-z][a-z0-9_]{0,30}')  # of a cell (waam_shop.cells)
FIRST = 'cell'


def order_of(argv: Sequence[str]) -> tuple[bytes, dict[str, str]] | None:
    """The byte for the bridge and the options; None: nothing to do, or not understood."""
    from waam_node.stop_socket import HOLD, STOP

    verbs = {('stop',): STOP, ('job', 'abort'): STOP, ('job', 'pause'): HOLD}
    words = next((v for v in verbs if tuple(argv[: len(v)]) == v), None)
    if words is None:
        return None
    options = _options(list(argv[len(words) :]))
    return None if options is None else (verbs[words], options)


def _options(rest: list[str]) -> dict[str, str] | None:
    """As argparse reads them: `--run X`, `--run=X`, and beginnings of the names."""
    found: dict[str, str] = {}
    while rest:
        word, equals, value = rest.pop(0).partition('=')
        names = [v for v in (*VALUES, *HELP) if v == word or (v.startswith(word) and len(word) > 2)]
        if len(names) != 1 or names[0] in HELP or not word.startswith('--'):
            return None
        if not equals:
            if not rest or rest[0].startswith('-'):
                return None
            value = rest.pop(0)
        found[names[0]] = value
        if names[0] in ('--cell', '--name'):
            found['cell'] = value
    return found


def run_folder(options: Mapping[str, str], environment: Mapping[str, str]) -> str | None:
    """The folder of the graph that is meant, as `paths.run_dir` has it; None for a name that is none."""
    cell = options.get('cell') or environment.get('WAAM_CELL') or FIRST
    if not NAME.fullmatch(cell):
        return None
    if '--run' in options:
        return os.path.realpath(options['--run'])
    if 'WAAM_RUN' in environment:
        return os.path.realpath(environment['WAAM_RUN'])
    root = os.path.realpath(environment.get('WAAM_ROOT', '.'))
    jobs = os.path.realpath(environment.get('WAAM_JOBS', os.path.join(root, 'jobs')))
    below = () if cell == FIRST else ('cells', cell)
    return os.path.realpath(os.path.join(jobs, *below, '.run'))


def act(argv: Sequence[str]) -> None:
    """Sends the byte if the command is one of these. What went wrong is for the command that follows: with no bridge
    there is nothing to stop here."""
    understood = order_of(argv)
    folder = run_folder(understood[1], os.environ) if understood else None
    if understood is None or folder is None:
        return
    from waam_node.stop_socket import NAME as SOCKET
    from waam_node.stop_socket import send

    path = os.path.join(folder, SOCKET)
    if os.path.exists(path) and (problem := send(path, understood[0], PATIENCE_S)):
        print(f'waam: {problem}', file=sys.stderr)


if __name__ == '__main__':
    source = os.path.dirname(os.path.dirname(os.path.dirname(os.path.realpath(__file__))))
    sys.path.insert(0, os.path.join(source, 'waam_node'))
    act(sys.argv[1:])
