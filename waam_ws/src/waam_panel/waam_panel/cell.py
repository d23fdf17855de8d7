"""What all requests share: state, operations, folders, and the pump that empties the mailbox. No ROS."""

from __future__ import annotations

import asyncio
import itertools
import secrets
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from aiohttp import web

from waam_node import job_folder, stop_socket
from waam_process.grid import HeightGrid
from waam_process.safe_files import is_file, read_bytes
from waam_view.job_data import shaft_in
from waam_view.mailbox import Mailbox
from waam_view.worst_places import error_after

from . import calibrated, history, pictures
from .archive_page import ArchivePage
from .background import BackgroundTasks
from .commissioning import Commissioning
from .gate import Gate
from .operations import InShop, Operations, Refused
from .parts import PartFolders
from .programs import Programs
from .security import Guard
from .setup_form import LAST_SCAN, JobSetup
from .state import PanelState
from .throttle import Throttle
from .worker import WorkError, plan_arguments, work

PUMP_S = 0.1
Answer = TypeVar('Answer')


@dataclass
class Cell:
    """One panel. Everything here runs in the web thread, but for `operations`, which block and go through `do`."""

    guard: Guard
    state: PanelState
    operations: Operations
    mailbox: Mailbox
    convert: Callable[[str, Any], Any]
    parts: PartFolders
    jobs_dir: Path
    materials: tuple[str, ...]
    error_range: float = 0.6e-3
    upload_bytes: int = 64 << 20
    wrong_token_s: float = 1.0
    boot: str = field(default_factory=lambda: secrets.token_hex(4))
    setup: JobSetup | None = None
    going_on: Path | None = None  # an interrupted job to resume, instead of a setup
    problem: str = ''
    pages: int = 0  # open streams
    shop: InShop | None = None  # queue, audit log, messages; None: without
    shop_turns: int = 10  # of the pump, for one look of the shop
    calibrations: Path | None = None  # folder of results; None: none are looked at
    stop_socket: str = ''  # of the bridge, for STOP and HOLD past everything; '' = none
    stop_port: int = 0  # of the second way for STOP of a page; 0 = none
    gate: Gate | None = None  # who is connected; None: not counted
    # of Python, which commission this cell; () = nothing does
    commission: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.archive, self.programs = ArchivePage(self.jobs_dir), Programs(self.parts)
        self.work_lock, self.background = asyncio.Lock(), BackgroundTasks()
        self.throttle = Throttle(self.wrong_token_s)
        self.commissioning = Commissioning(self.commission)
        self.entries = 0  # of the audit log that wait
        self.writing: set[asyncio.Task[str]] = set()
        self._workers = ThreadPoolExecutor(4, 'command')
        self._stoppers = ThreadPoolExecutor(4, 'stop')  # never behind a slow command
        self._scratch = tempfile.TemporaryDirectory(prefix='waam_panel_')
        self.preview = Path(self._scratch.name) / 'plan' / 'preview.png'
        self._judged = ('', -1)
        self._looked_for_shaft = ''  # in this folder of a job
        self._calibrated = calibrated.Watch()

    def close(self) -> None:
        """Ends the worker threads without waiting for what they do, and removes the scratch folder."""
        self.commissioning.end()
        if self.shop:
            self.shop.close()
        self._workers.shutdown(wait=False, cancel_futures=True)
        self._stoppers.shutdown(wait=False, cancel_futures=True)
        if self.entries:
            text = (
                f'{self.entries} entries of the audit log were not written before the panel ended'
            )
            print(f'waam: {text}', file=sys.stderr, flush=True)
        self.background.close()
        self._scratch.cleanup()

    def at_once(self, order: bytes) -> None:
        """To the bridge, past everything; never waits. That it is not there says the command that follows."""
        if self.stop_socket:
            with suppress(OSError):
                stop_socket.post(self.stop_socket, order).close()

    async def do(self, operation: Callable[..., Answer], *arguments: Any) -> Answer:
        """A blocking operation in a worker thread; stop has threads of its own."""
        pool = self._stoppers if operation == self.operations.stop else self._workers
        return await asyncio.get_running_loop().run_in_executor(pool, operation, *arguments)

    async def settings(self) -> dict[str, float]:
        """Those that the controller has. Refused when it does not say."""
        return await self.do(self.operations.settings)

    def check_no_job(self) -> None:
        """Raises Refused while a job runs, or may run: its node does not answer; and while the cell is commissioned."""
        if self.state.job_running:
            raise Refused(self.state.stale(time.monotonic()).get('job') or 'a job is running')
        if self.commissioning.running:
            raise Refused('the commissioning runs: end it first (page Commissioning)')

    # ---- what arrives

    async def pump(self) -> None:
        """Ten times a second: messages into the state. One that cannot be read is left out and reported."""
        for turn in itertools.count():
            if turn % 10 == 0:
                operations = self.operations
                self.state.sections['cell'] = {
                    'simulated': operations.simulated,
                    'adjustable': operations.adjustable,
                    'unrolled': self.state.shaft is not None,
                }
                now, utc = time.monotonic(), time.time()
                self._look_at_calibrations(now, utc)
            items, newest = self.mailbox.take(0.0)
            for name, message in (*items, *newest):
                try:
                    value = self.convert(name, message)
                    self.state.apply(name, value, time.monotonic(), time.time())
                except (ValueError, IndexError, TypeError) as e:
                    self.problem = f'{name}: {type(e).__name__}: {e}'
            self.state.look(time.monotonic(), time.time())
            self.state.sections['commission'] = self.commissioning.shown()
            self.background.start('error map', self._judge)
            self.background.start('shaft', self._look_for_shaft)
            if turn % self.shop_turns == 0 and self.shop:
                self.shop.tick(self)
            await asyncio.sleep(PUMP_S)

    def _look_at_calibrations(self, now: float, utc: float) -> None:
        async def look() -> None:
            folder = self.calibrations
            changed = await self.background.thread('calibrations', calibrated.changed, folder)
            self._calibrated.look(folder, changed, self.state, self.settings, now, utc)

        if self.calibrations is not None:
            self.background.start('calibrations', look)

    async def _look_for_shaft(self) -> None:
        job = self.state.sections.get('job')
        folder = job['dir'] if job else ''
        if folder != self._looked_for_shaft:
            found = (
                await self.background.thread('shaft', shaft_in, Path(folder)) if folder else None
            )
            self.state.shaft, self._looked_for_shaft = found, folder

    async def _judge(self) -> None:
        """Draws the error of a scan once the job has written the surface wanted after its layer."""
        scan, job = self.state.scan, self.state.sections.get('job')
        if not scan or not job or not job['dir']:
            return
        this = (scan['job_id'], scan['scan_id'])
        if self._judged == this or job_folder.job_of(scan['job_id']) != job['id']:
            return
        folder, layer = Path(job['dir']), scan['layer']
        after = await self.background.thread(
            'error map', error_after, folder, layer, scan['spec'], scan['z']
        )
        if after is not None:
            self._judged = this
            reach = self.error_range
            picture = pictures.encode_map(scan['spec'], after.error, -reach, reach)
            title = f'scan {scan["scan_id"]} after layer {layer}: measured minus wanted'
            if beyond := after.share_beyond(reach):
                title += f', {beyond:.1%} of the judged area beyond the colours'
            places = [{'at': [p.x_mm, p.y_mm, p.z_mm], 'words': p.words()} for p in after.places]
            self.state.put_map('error', picture | {'title': title, 'places': places})

    # ---- slow work

    def as_found(self, setup: JobSetup) -> Path | None:
        """The file that a restoration is planned from; the newest scan is written out. Raises WorkError."""
        if setup.mode == 'build' or not setup.as_found:
            return None
        if setup.as_found != LAST_SCAN:
            return self.parts.find(setup.as_found)
        if self.state.scan is None:
            raise WorkError('there is no scan yet')
        file = Path(self._scratch.name) / 'scan.npz'
        HeightGrid(self.state.scan['spec'], self.state.scan['z']).save_npz(file)
        return file

    async def on_table(self, setup: JobSetup, worn: Path | None) -> Path | None:
        """What the simulated cell is to put on its table: the worn part where the program expects it, a height map; the
        file itself where there is none, or the cell is real. Raises WorkError, PartsError."""
        if worn is None or setup.mode == 'build' or not self.operations.simulated:
            return worn
        file = Path(self._scratch.name) / 'table.npz'
        async with self.work_lock:
            await work(['table', str(self.parts.find(setup.part)), str(worn), str(file)])
        return file

    async def make_preview(self, setup: JobSetup) -> str:
        """Plans the part; the picture lies at `preview`. Returns the table. Raises WorkError, PartsError."""
        out = self.preview.parent
        arguments = plan_arguments(setup, self.parts.find(setup.part), self.as_found(setup), out)
        async with self.work_lock:
            self.preview.unlink(missing_ok=True)
            lines = (await work(arguments)).splitlines()
        return '\n'.join(line for line in lines if not line.startswith('written:'))

    async def report_page(self, name: str, inner: str) -> bytes:
        """report.html of a job, or of a run inside a demo. Raises HistoryError, WorkError, FileError."""
        folder = history.find(self.jobs_dir, name)
        folder = history.find(folder, inner) if inner else folder
        if not is_file(folder / job_folder.REPORT):
            raise history.HistoryError(f'{name} has no report')
        async with self.work_lock:
            if history.report_is_old(folder):
                await work(['report', str(folder)])
            return await self.background.thread(
                'files', read_bytes, folder / job_folder.REPORT_PAGE
            )


CELL: web.AppKey[Cell] = web.AppKey('cell', Cell)  # where the server keeps it
