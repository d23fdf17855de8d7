"""`waam stop`, `job abort` and `job pause` tell the bridge before anything is loaded, whoever holds which lock."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from waam_bringup import at_once, paths
from waam_bringup.cli import build_parser
from waam_node.locks import locked
from waam_node.stop_socket import HOLD, OK, STOP, Listener

WAAM = str(Path(__file__).parents[4] / 'waam')
FILE = Path(at_once.__file__)
NAMES = ('WAAM_CELL', 'WAAM_RUN', 'WAAM_JOBS', 'WAAM_SHOP', 'WAAM_ROOT')
VERBS = {'stop': STOP, 'job abort': STOP, 'job pause': HOLD}


class FakeBridge:
    """got: orders in the order of their arrival, with the steady time."""

    def __init__(self, run: Path) -> None:
        run.mkdir(parents=True, exist_ok=True)
        self.got: list[tuple[bytes, float]] = []
        self._listener = Listener(str(run / 'stop'))
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while messages := self._listener.receive():
                for order, whom in messages:
                    self.got.append((order, time.monotonic()))
                    self._listener.answer(OK, whom)

    def until(self, count: int) -> list[bytes]:
        end = time.monotonic() + 30
        while len(self.got) < count:
            assert time.monotonic() < end, f'{len(self.got)} of {count} orders'
            time.sleep(0.005)
        return [order for order, _ in self.got]

    def close(self) -> None:
        self._listener.close()


@pytest.fixture
def bridge_in():
    made: list[FakeBridge] = []

    def make(run: Path) -> FakeBridge:
        made.append(FakeBridge(run))
        return made[-1]

    yield make
    for bridge in made:
        bridge.close()


def waam(tmp_path: Path, *words: str) -> subprocess.CompletedProcess[str]:
    kept = {k: v for k, v in os.environ.items() if k not in NAMES}
    env = kept | {'WAAM_JOBS': str(tmp_path / 'jobs')}
    return subprocess.run([*words], env=env, capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize(
    'verb,options,cell',
    [('stop', '', 'cell'), ('job abort', '--run {run}', 'run'), ('job pause', '--cell cell2', 'cell2'),
     ('stop', '--run={run}', 'run'), ('job abort', '--ce cell2', 'cell2')],
)  # fmt: skip
def test_the_bridge_is_told_with_every_way_to_write_the_options(
    tmp_path, bridge_in, verb, options, cell
):
    folders = {'cell': 'jobs/.run', 'cell2': 'jobs/cells/cell2/.run', 'run': 'here'}
    bridges = {name: bridge_in(tmp_path / folder) for name, folder in folders.items()}
    words = [*verb.split(), *options.format(run=tmp_path / 'here').split()]
    ran = waam(tmp_path, WAAM, *words)
    assert bridges[cell].until(1) == [VERBS[verb]]
    assert all(b.got == [] for name, b in bridges.items() if name != cell)
    assert 'Traceback' not in ran.stderr


@pytest.mark.parametrize('verb', ['stop', 'job pause'])
def test_it_acts_while_the_audit_log_is_held(tmp_path, bridge_in, verb):
    """A suspended `waam audit`: the order comes, then the command goes on, and says that its entry is missing."""
    bridge = bridge_in(tmp_path / 'jobs/.run')
    with locked(tmp_path / 'jobs/.shop/cells/cell/audit.jsonl.lock'):
        ran = waam(tmp_path, WAAM, *verb.split())
    assert bridge.until(1) == [VERBS[verb]]
    assert 'not in the audit log' in ran.stderr and f'process {os.getpid()}' in ran.stderr
    assert 'no graph is up' in ran.stdout + ran.stderr


@pytest.mark.parametrize('name', ['audit.jsonl', 'audit.jsonl.lock'])
def test_it_ends_although_the_disk_hangs(tmp_path, bridge_in, name):
    """A pipe that nobody reads stands for a disk that does not answer: to open it takes for ever."""
    bridge = bridge_in(tmp_path / 'jobs/.run')
    folder = tmp_path / 'jobs/.shop/cells/cell'
    folder.mkdir(parents=True)
    os.mkfifo(folder / name)
    ran = waam(tmp_path, WAAM, 'stop')
    assert bridge.until(1) == [STOP] and ran.returncode == 0
    assert 'not in the audit log' in ran.stderr or name.endswith('lock')


def test_the_installed_command_acts_first_as_well(tmp_path, bridge_in):
    bridge = bridge_in(tmp_path / 'jobs/.run')
    code = 'import sys; from waam_bringup.entry import main; sys.exit(main())'
    ran = waam(tmp_path, sys.executable, '-c', code, 'job', 'abort')
    assert bridge.until(1) == [STOP] and ran.returncode == 2


def test_it_loads_nothing_but_the_standard_library():
    """With -I -S there is no other package on the path."""
    words = [sys.executable, '-I', '-S', '-X', 'importtime', str(FILE), 'stop', '--run', '/nowhere']
    ran = subprocess.run(words, capture_output=True, text=True, timeout=60, check=True)
    loaded = {line.rsplit('|', 1)[1].strip() for line in ran.stderr.splitlines() if '|' in line}
    assert not loaded & {'argparse', 'asyncio', 'pathlib', 'subprocess', 'rclpy', 'numpy', 'json'}


LINES = st.lists(
    st.sampled_from([
        'stop', 'job', 'abort', 'pause', 'resume', 'run', '--run', '--run=x', '--cell', '--name', '--domain',
        '--domain=5', 'cell2', '5', '-h', '--help', '--he', '--c', '--ru', 'x', '--', '--nothing', '-x', '',
    ]), max_size=6,
)  # fmt: skip


@settings(max_examples=400, suppress_health_check=[HealthCheck.filter_too_much])
@given(LINES)
def test_what_is_understood_here_is_what_the_command_line_understands(words):
    """Nothing is stopped by a line that the command refuses, and by no other verb."""
    found = at_once.order_of(words)
    try:
        with contextlib.redirect_stderr(None), contextlib.redirect_stdout(None):
            args = build_parser().parse_args(words)
        verb = ' '.join(words[:1] if words[:1] == ['stop'] else words[:2])
    except (SystemExit, AttributeError, ValueError):
        assert found is None or '--domain' in ' '.join(words), words
        return
    finally:
        os.environ.pop('WAAM_CELL', None)
    if found is None:
        return  # the command itself acts, a second later
    assert verb in VERBS and found[0] == VERBS[verb]
    assert found[1].get('--run') == (str(args.run) if args.run else None)
    assert found[1].get('cell') == args.cell


FOLDER = st.sampled_from(['/tmp/a', '/tmp/a/../b', 'relative', '/tmp/link'])


@given(
    st.dictionaries(st.sampled_from(['WAAM_RUN', 'WAAM_JOBS', 'WAAM_ROOT']), FOLDER),
    st.sampled_from([None, 'cell', 'cell2']),
    st.sampled_from([None, 'cell', 'cell3']),
)
def test_the_folder_is_the_one_of_the_command(folders, by_environment, by_option):
    given_environment = folders | ({'WAAM_CELL': by_environment} if by_environment else {})
    options = {'cell': by_option} if by_option else {}
    before = {n: os.environ.pop(n, None) for n in NAMES}
    try:
        os.environ |= given_environment | ({'WAAM_CELL': by_option} if by_option else {})
        wanted = paths.run_dir()
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value
    assert at_once.run_folder(options, given_environment) == str(wanted)


def test_a_name_that_is_none_stops_nothing():
    for name in ('', 'Cell', '../cell', 'x' * 40):
        assert at_once.run_folder({'cell': name}, {}) is None or name == ''
