"""A graph with the panel for the browser, and a panel without ROS for everything else."""

from __future__ import annotations

import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from waam_node.stl import write_worn_block
from waam_node.testing import fresh_domain
from waam_panel.cell import Cell
from waam_panel.operations import Place, Refused, StandoffSettings
from waam_panel.parts import PartFolders
from waam_panel.security import Guard
from waam_panel.shop_link import ShopLink
from waam_panel.sources import PROGRAMS
from waam_panel.state import PanelState, Sample
from waam_panel.web import WebServer
from waam_shop.notifier import Notifier
from waam_shop.notify_settings import NotifySettings
from waam_shop.roles import ROLES, role_of
from waam_shop.shop_folder import Shop
from waam_view.mailbox import Mailbox

sys.path.insert(0, str(Path(__file__).parent))  # helpers beside the tests


@pytest.fixture(scope='session')
def domain() -> int:
    return fresh_domain()


@pytest.fixture(scope='session')
def write_part():
    return make_part


def make_part(folder: Path) -> tuple[Path, Path]:
    """Nominal and worn block of 26 x 20 x 12 mm; the trough is 4 mm deep: two layers."""
    x, y = np.linspace(0, 26, 27), np.linspace(0, 20, 21)
    gx, gy = np.meshgrid(x, y)
    trough = 4 * np.clip(1.5 - 1.5 * np.maximum(np.abs(gx - 13) / 11, np.abs(gy - 10) / 8), 0, 1)
    nominal, worn = write_worn_block(folder, x, y, 12.0, trough)
    return nominal.rename(folder / 'block.stl'), worn.rename(folder / 'block_worn.stl')


@dataclass
class FakeOperations:
    """Keeps what was asked for; `hang` makes every command but stop wait."""

    simulated: bool = True
    adjustable: bool = True
    asked: list[tuple] = field(default_factory=list)
    refuse: str = ''
    told: dict[str, float] | None = None  # settings of the controller; None: it does not say
    hang: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self.hang.set()

    def stop(self) -> str:
        self.asked.append(('stop',))
        return 'stopped'

    def settings(self) -> dict[str, float]:
        self.asked.append(('settings',))
        if self.told is None:
            raise Refused('the controller does not answer')
        return dict(self.told)

    def standoff(self) -> StandoffSettings:
        return StandoffSettings('laser', 'pid', 0.1, 0.006, 0.004, 0.0016)

    def __getattr__(self, name: str):
        if name.startswith('_'):
            raise AttributeError(name)

        def operation(*arguments) -> str:
            self.hang.wait(20)
            if self.refuse:
                raise Refused(self.refuse)
            self.asked.append((name, *arguments))
            return name

        return operation


@dataclass
class Panel:
    """A served panel without ROS."""

    server: WebServer
    cell: Cell
    operations: FakeOperations
    folder: Path
    tokens: dict[str, str] = field(default_factory=dict)  # role -> token, of a panel with tokens
    # section -> what its program says again and again
    saying: dict[str, object] = field(default_factory=dict)
    living: tuple[str, ...] = ()  # nodes that give signs of life

    def speak(self, *said: tuple[str, object]) -> None:
        """From now on the programs of the cell live and say this, some times a second."""
        self.living = PROGRAMS
        self.saying = dict(said)

    def say(self) -> None:
        """Once; called by the fixture."""
        for name, value in dict(self.saying).items():
            self.cell.mailbox.put((name, value))
        rows = [
            {'node': n, 'level': 0, 'message': 'ok', 'viewer': '', 'restarted': ''}
            for n in self.living
        ]
        if rows:
            self.cell.mailbox.put(('diagnostics', rows))

    @staticmethod
    def job(state: str, **values) -> dict:
        """A job_status as `conversions.job` gives it."""
        told = {
            'id': '20260101_jaw', 'dir': '', 'state': state, 'loop_mode': 'closed_loop', 'material': 'er70s-6',
            'k_gain': 0.2, 'layer': 1, 'layers': 3, 'bead': 2, 'beads': 9, 'pass': 1, 'passes': 1, 'progress': 0.3,
            'time_left': 600.0, 'rms_mm': 0.1, 'max_mm': 0.3, 'error_code': 0, 'message': '',
        }  # fmt: skip
        return told | ({'id': '', 'layers': 0} if state == 'IDLE' else {}) | values

    @staticmethod
    def still(**values) -> Sample:
        """A frame of a machine that stands."""
        told = {
            't': 1.0, 'position': (0.01, 0.02, 0.03), 'current': 0.0, 'voltage': 0.0, 'feed_commanded': 0.0,
            'feed': 0.0, 'speed': 0.0, 'state': 'IDLE', 'arc': False, 'arc_enabled': False, 'gas': False,
            'speed_override': 1.0, 'wire_override': 1.0, 'lease_left': 0.4,
        }  # fmt: skip
        return Sample(**told | values)

    @property
    def url(self) -> str:
        return f'http://127.0.0.1:{self.server.port}'

    @property
    def csrf(self) -> str:
        return self.cell.guard.csrf('')


@pytest.fixture
def make_panel(tmp_path) -> Iterator:
    """make_panel(tokens=False, hosts=(), name='cell', tls=None) -> Panel; all of a test are of one shop."""
    made: list[Panel] = []

    def make(
        tokens: bool = False, hosts: tuple[str, ...] = (), name: str = 'cell', tls=None
    ) -> Panel:
        operations, cells, shop = FakeOperations(), [], Shop(tmp_path / 'shop')
        given = {r: shop.tokens().create(f'{r} {len(made)}', role_of(r)) for r in ROLES if tokens}

        def cell(port: int) -> Cell:
            cells.append(
                Cell(
                    guard=Guard.create(shop.tokens() if tokens else None, '127.0.0.1', port, hosts),
                    state=PanelState(100),
                    operations=operations,
                    mailbox=Mailbox(),
                    convert=lambda _, message: message,
                    parts=PartFolders((tmp_path / 'parts',)),
                    jobs_dir=tmp_path / 'jobs',
                    materials=('er70s-6', '316l'),
                    upload_bytes=1 << 20,
                    wrong_token_s=0.01,
                    shop_turns=2,
                    shop=ShopLink(shop, Place(name), Notifier(NotifySettings(), name)),
                )
            )
            return cells[0]

        server = WebServer(cell, '127.0.0.1', 0, tls)
        assert not server.problem, server.problem
        made.append(Panel(server, cells[0], operations, tmp_path, given))
        return made[-1]

    over = threading.Event()

    def speak() -> None:
        while not over.wait(0.2):
            for panel in list(made):
                panel.say()

    threading.Thread(target=speak, daemon=True).start()
    yield make
    over.set()
    for panel in made:
        panel.operations.hang.set()
        panel.server.close()


@pytest.fixture
def panel(make_panel) -> Panel:
    return make_panel()


@pytest.fixture
def made_jobs(tmp_path, monkeypatch):
    """made_jobs(number, ...): a finished job in the panel's folder of jobs, without running one."""
    archive = Path(__file__).parents[2] / 'waam_archive' / 'test'
    monkeypatch.syspath_prepend(str(archive))
    from made_jobs import make_job

    return lambda number, **of: make_job(tmp_path / 'jobs', number, **of)


@pytest.fixture(scope='session')
def certificate(tmp_path_factory) -> tuple[str, str]:
    """Certificate of 127.0.0.1 and its key, made for this run."""
    openssl = shutil.which('openssl')
    if not openssl:
        pytest.skip('openssl is not installed')
    folder = tmp_path_factory.mktemp('tls')
    cert, key = folder / 'cert.pem', folder / 'key.pem'
    subprocess.run(
        [openssl, 'req', '-x509', '-newkey', 'ec', '-pkeyopt', 'ec_paramgen_curve:prime256v1', '-nodes', '-days', '1',
         '-keyout', str(key), '-out', str(cert), '-subj', '/CN=cell', '-addext', 'subjectAltName=IP:127.0.0.1'],
        check=True, capture_output=True,
    )  # fmt: skip
    key.chmod(0o600)
    return str(cert), str(key)


@pytest.fixture(scope='module')
def browser(request):
    """A browser for a module of tests, which says where it lies (CHROMIUM)."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        made = p.chromium.launch(executable_path=request.module.CHROMIUM, args=['--no-sandbox'])
        yield made
        made.close()
