"""What ties a panel to its shop: once a second the queue is run, the state of the cell told, people are told. No ROS.

Each has a task and a thread of its own (`background`): a lock or a disk that hangs holds up that one, not the display.

Two panels of one cell: only the first one does that, the other one shows.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any

from waam_shop.cells import CellStatus
from waam_shop.durable import Ownership
from waam_shop.job_queue import Item, Queue, QueueError
from waam_shop.notifier import Notifier
from waam_shop.runner import CellView, Runner
from waam_shop.shop_folder import Shop

from . import calibrated
from .background import AUDIT
from .cell import Cell
from .deeds import Deed, Deeds
from .operations import Place, Refused
from .parts import PartsError, sha256_of
from .people import People
from .programs import ProgramRefused
from .queued import Start
from .setup_form import FormError
from .state import UNKNOWN

BELIEVED = ('machine',)  # without news of these nothing starts
UNSAID = 1000  # entries that wait for a log that cannot be written
STOPPED = 'STOP was pressed or a commissioning begun: release it again'


class ShopLink:
    """See `operations.InShop`. Runs in the web thread; what blocks goes to worker threads."""

    def __init__(self, shop: Shop, place: Place, notifier: Notifier) -> None:
        self.shop, self.place, self.notifier = shop, place, notifier
        self.queue, self.audit = shop.queue(place.name), shop.audit(place.name)
        self._owner = Ownership(shop.folder(place.name) / 'panel.lock')
        self._runner, self._people, self._deeds = Runner(), People(notifier), Deeds()
        self._starting: asyncio.Task[None] | None = None
        self._unsaid: deque[Deed] = deque(maxlen=UNSAID)
        self._lost = 0  # deeds for which there was no room
        self._first = False  # this panel runs the queue
        self._stops = self._stops_seen = 0
        self._counts: dict[str, int] = {}
        self._next = ''

    def stop_pressed(self) -> None:
        """What is released or about to start waits for a new release."""
        self._stops += 1

    def tick(self, cell: Cell) -> None:
        """Starts what is due; what the disk refuses is reported by `beside`."""
        background = cell.background
        if self.notifier.problem:
            cell.problem = self.notifier.problem

        async def own() -> None:
            self._first = await background.thread('shop', self._owner.take)

        async def tell() -> None:
            await background.thread('status', self.shop.tell, self.status(cell))

        async def people() -> None:
            await background.thread('messages', self._people.look, cell.state)

        background.start('shop', own)
        if not self._first:
            return
        background.start('queue', lambda: self._run_queue(cell))
        background.start('status', tell)
        background.start('messages', people)
        self._see(self._deeds.look(cell.state))
        background.start('audit log', lambda: self._say(cell))

    def close(self) -> None:
        """Tells that the cell is down."""
        if self._owner.take():
            last = self.shop.status(self.place.name)
            if last:
                self.shop.tell(replace(last, down=True, utc=time.time()))
        self.notifier.close()
        self._owner.give()

    # ---- the queue

    async def _run_queue(self, cell: Cell) -> None:
        if self._starting is not None and not self._starting.done():
            return
        view, stops = view_of(cell), self._stops
        try:
            item = await cell.background.thread(
                'queue', self._step, view, stops != self._stops_seen
            )
        except (OSError, QueueError):
            self._runner = Runner()  # what it decided is perhaps not on the disk: it begins anew
            self._counts, self._next = {}, ''  # not known
            raise
        self._stops_seen = stops
        self._starting = asyncio.create_task(self._start(cell, item, stops)) if item else None

    def _step(self, view: CellView, stopped: bool) -> Item | None:
        begun: list[Item | None] = []

        def change(queue: Queue) -> Queue:
            queue = queue.withdraw(STOPPED) if stopped else queue
            queue, item = self._runner.step(queue, view, time.monotonic())
            begun.append(item)
            return queue

        unfinished = self.queue.change(change).unfinished()
        states = [i.state for i in unfinished]
        self._counts = {s: states.count(s) for s in sorted(set(states))}
        self._next = unfinished[0].part if unfinished else ''
        return begun[-1]

    async def _start(self, cell: Cell, item: Item, stops: int) -> None:
        """Puts the part on the table of a simulated cell and starts; what is refused waits for a new release."""
        try:
            await self._log(cell, item, 'asked')
            await calibrated.check(cell.calibrations, cell.settings)
            start = Start(cell, item.setup)
            await cell.background.thread('files', _check_part, start.file, item.sha256)
            await start.load()
            if self._stops != stops:
                raise Refused(STOPPED)
            await start.run()
            self._runner.started(time.monotonic())
        except (Refused, FormError, ProgramRefused, PartsError, QueueError, OSError) as e:
            await self._back(cell, item, str(e))

    async def _back(self, cell: Cell, item: Item, why: str) -> None:
        try:
            await cell.background.thread('queue', self.queue.change, lambda q: q.back(item.id, why))
            await self._log(cell, item, 'refused', why)
        except (OSError, QueueError) as e:
            cell.problem = f'queue: {e}'

    async def _log(self, cell: Cell, item: Item, outcome: str, note: str = '') -> None:
        data = {'id': item.id, 'part': item.part}

        def write() -> None:
            who = item.released_by
            self.audit.write('queue start', who, 'queue', outcome=outcome, data=data, note=note)

        await cell.background.thread(AUDIT, write)

    def _see(self, deeds: list[Deed]) -> None:
        """They wait until the log takes them; those for which there is no room are counted."""
        self._lost += max(0, len(self._unsaid) + len(deeds) - UNSAID)
        self._unsaid.extend(deeds)

    async def _say(self, cell: Cell) -> None:
        """What the cell was seen to do, into the audit log, in order."""
        while self._unsaid:
            what, data = self._unsaid[0]
            more = {'not written before': self._lost} if self._lost else {}

            def write(what: str = what, data: dict[str, Any] = data | more) -> None:
                self.audit.write(what, 'cell', 'cell', outcome='seen', data=data)

            await cell.background.thread(AUDIT, write)
            self._lost -= sum(more.values())
            self._unsaid.popleft()

    # ---- what others see

    def status(self, cell: Cell) -> CellStatus:
        """For the list of cells."""
        machine, job = _known(cell, 'machine'), _told_job(cell)
        alarm = cell.state.alarms.worst()
        return CellStatus(
            name=self.place.name, utc=time.time(), host=socket.gethostname(), domain=self.place.domain,
            page=self.place.page, simulated=bool(cell.operations.simulated),
            connected=bool(machine.get('connected')), machine=str(machine.get('state', '')),
            armed=bool(machine.get('armed')), job=str(job.get('id', '')), job_state=str(job.get('state', '')),
            job_message=str(job.get('message', ''))[:200], progress=float(job.get('progress') or 0.0),
            time_left=job.get('time_left'), layer=int(job.get('layer') or 0), layers=int(job.get('layers') or 0),
            alarm=alarm['title'] if alarm else '', severity=alarm['severity'] if alarm else 0,
            queue=dict(self._counts), next=self._next,
        )  # fmt: skip


def view_of(cell: Cell) -> CellView:
    """What decides whether a job of the queue may start."""
    machine, job = _known(cell, 'machine'), _known(cell, 'job')
    late = [n for n in cell.state.stale(time.monotonic()) if n in BELIEVED]
    return CellView(
        connected=bool(machine.get('connected')), machine=str(machine.get('state', '')),
        job=str(job.get('id', '')), job_state=str(job.get('state', '')),
        job_message=str(job.get('message', '')), late=tuple(late),
    )  # fmt: skip


def _known(cell: Cell, name: str) -> dict[str, Any]:
    """What a section says, {} while it cannot be believed."""
    stale = cell.state.stale(time.monotonic())
    return {} if name in stale else cell.state.sections.get(name) or {}


def _told_job(cell: Cell) -> dict[str, Any]:
    """As it is told to others: of a job whose node is silent or has died, which one and why."""
    state, why = cell.state, cell.state.stale(time.monotonic()).get('job', '')
    if state.lost_job:
        return {'id': state.lost_job['id'], 'state': UNKNOWN, 'message': state.lost_job['why']}
    if why and state.job_running:
        return {'id': state.sections['job'].get('id', ''), 'state': UNKNOWN, 'message': why}
    return state.sections.get('job') or {}


def _check_part(file: Path, sha256: str) -> None:
    if sha256 and sha256_of(file) != sha256:
        raise QueueError(f'{file.name} has changed since it was put into the queue')
