"""Which item of the queue starts when, and what became of it. Pure: what the panel sees goes in, a queue comes out."""

from __future__ import annotations

from dataclasses import dataclass

from waam_process.names import JOB_RUNNING

from .job_queue import ABORTED, DONE, FAILED, INTERRUPTED, RELEASED, RUNNING, Item, Queue

SEEN_S = 60.0  # a started job must be seen within
ENDS = {'DONE': DONE, 'FAILED': FAILED, 'ABORTED': ABORTED}
AGAIN = 'the panel was started again: release it again'


@dataclass(frozen=True)
class CellView:
    """machine: state of the controller, '' while unknown; job: id of the newest job, '' = none; job_state: as in
    JobStatus, '' while none has arrived; late: what is too old to be believed."""

    connected: bool = False
    machine: str = ''
    job: str = ''
    job_state: str = ''
    job_message: str = ''
    late: tuple[str, ...] = ()

    @property
    def job_running(self) -> bool:
        """A job is under way."""
        return self.job_state in JOB_RUNNING


def blocked(view: CellView) -> str:
    """Why nothing can start now, '' when it can."""
    if not view.connected:
        return 'waits: the controller is not connected'
    if view.late:
        return f'waits: no news from {", ".join(view.late)}'
    if not view.job_state:
        return 'waits: job_sequencer does not answer'
    if view.machine != 'IDLE':
        return f'waits: the machine is in {view.machine or "an unknown state"}'
    return ''


class Runner:
    """One per panel. `step` once a second; when it returns an item, start its job and call `started`."""

    def __init__(self) -> None:
        self._fresh = True
        self._mine = 0  # id of the item that this panel has started
        self._before = ''
        self._since = 0.0

    def step(self, queue: Queue, view: CellView, now: float) -> tuple[Queue, Item | None]:
        """The queue as it is from now on, and an item to start at once. now: s of a steady clock."""
        if self._fresh:
            self._fresh = False
            queue = queue.withdraw(AGAIN)
        running, released = queue.in_state(RUNNING), queue.in_state(RELEASED)
        if running:
            return self._follow(queue, running, view, now), None
        if not released:
            return queue, None
        if view.job_running:
            return queue.withdraw(f'another job was started: {view.job}'), None
        reason = blocked(view)
        if reason:
            return queue.tell(released.id, note=reason), None
        self._mine, self._before, self._since = released.id, view.job, now
        return queue.begin(released.id), released

    def started(self, now: float) -> None:
        """The cell has taken the job."""
        self._since = now

    def _follow(self, queue: Queue, item: Item, view: CellView, now: float) -> Queue:
        if not view.job_state:
            return queue
        if not item.job:
            return self._first_seen(queue, item, view, now)
        if view.job != item.job:
            return queue.finish(item.id, INTERRUPTED, 'the job is gone; look at Jobs')
        if view.job_running:
            return queue
        end = ENDS.get(view.job_state, INTERRUPTED)
        return queue.finish(item.id, end, view.job_message)

    def _first_seen(self, queue: Queue, item: Item, view: CellView, now: float) -> Queue:
        if self._mine != item.id:
            text = 'the panel ended at the moment of the start; look at Jobs'
            return queue.finish(item.id, INTERRUPTED, text)
        if view.job and view.job != self._before:
            queue = queue.tell(item.id, job=view.job)
            return self._follow(queue, queue.item(item.id), view, now)
        if now - self._since > SEEN_S:
            return queue.finish(item.id, INTERRUPTED, 'the job did not begin; look at Cell')
        return queue
