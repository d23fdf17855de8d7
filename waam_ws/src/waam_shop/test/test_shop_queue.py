"""The queue: a random row of operations with kills equals a model; nothing starts without a release; files are safe."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_shop import durable
from waam_shop.audit_file import AuditLog
from waam_shop.job_queue import (
    ENDED,
    INTERRUPTED,
    RELEASED,
    RUNNING,
    WAITING,
    Queue,
    QueueError,
)  # fmt: skip
from waam_shop.queue_file import QueueFile
from waam_shop.runner import SEEN_S, CellView, Runner

READY = CellView(connected=True, machine='IDLE', job_state='IDLE')


def filled(count: int) -> Queue:
    queue = Queue()
    for n in range(1, count + 1):
        queue = queue.add({'part': f'{n}.stl'}, 'Ada', float(n))
    return queue


def ids(queue: Queue, state: str = WAITING) -> list[int]:
    return [i.id for i in queue.items if i.state == state]


def test_items_wait_in_order_and_move():
    queue = filled(4).move(4, 1).move(1, 4)
    assert ids(queue) == [4, 2, 3, 1]
    for place in (0, 5):
        with pytest.raises(QueueError, match='1 to 4'):
            queue.move(4, place)


def test_one_release_at_a_time_and_worth_one_start():
    queue = filled(3).release(2, 'Kim')
    assert ids(queue, RELEASED) == [2] and ids(queue) == [1, 3]
    with pytest.raises(QueueError, match='item.2 is released'):
        queue.release(1, 'Kim')
    running = queue.begin(2)
    for refused in (running.begin, running.remove, running.hold):
        with pytest.raises(QueueError, match='running|runs'):
            refused(2)
    with pytest.raises(QueueError, match='item.2 is running'):
        running.release(1, 'Kim')
    assert ids(running.back(2, 'no controller')) == [2, 1, 3]
    with pytest.raises(QueueError):
        running.finish(2, 'done').release(2, 'Kim')


def test_without_a_release_nothing_ever_starts():
    runner, queue = Runner(), filled(3)
    for second in range(100):
        queue, item = runner.step(queue, READY, float(second))
        assert item is None
    assert ids(queue) == [1, 2, 3]


def test_a_released_item_starts_once_and_its_end_is_kept():
    runner, queue = Runner(), filled(2)
    queue, _ = runner.step(queue, READY, 0.0)
    queue = queue.release(1, 'Kim')
    queue, item = runner.step(queue, READY, 1.0)
    assert item and item.id == 1 and queue.item(1).state == RUNNING
    view = replace(READY, job='j1', job_state='DEPOSITING')
    for second in (2.0, 3.0):
        queue, item = runner.step(queue, view, second)
        assert item is None
    assert queue.item(1).job == 'j1'
    queue, item = runner.step(queue, replace(view, job_state='DONE', job_message='good'), 4.0)
    assert item is None and (queue.item(1).state, queue.item(1).note) == ('done', 'good')


@pytest.mark.parametrize(
    'view,word',
    [
        (replace(READY, connected=False), 'not connected'), (replace(READY, machine='ALARM'), 'ALARM'),
        (replace(READY, late=('machine',)), 'machine'), (replace(READY, job_state=''), 'job_sequencer'),
    ],
)  # fmt: skip
def test_a_cell_that_is_not_ready_keeps_the_release_waiting(view, word):
    runner = Runner()
    runner.step(Queue(), READY, 0.0)
    queue, item = runner.step(filled(1).release(1, 'Kim'), view, 1.0)
    assert item is None and queue.item(1).state == RELEASED and word in queue.item(1).note


def test_a_release_does_not_outlive_the_panel_nor_another_job():
    queue, item = Runner().step(filled(1).release(1, 'Kim'), READY, 0.0)
    assert item is None and 'release it again' in queue.item(1).note
    runner = Runner()
    runner.step(queue, READY, 0.0)
    busy = replace(READY, job='by hand', job_state='SCANNING')
    queue, item = runner.step(queue.release(1, 'Kim'), busy, 1.0)
    assert item is None and queue.item(1).state == WAITING and 'by hand' in queue.item(1).note


def test_a_panel_that_starts_again_finds_its_running_job_or_says_that_it_is_gone():
    begun = filled(1).release(1, 'Kim').begin(1)
    running = begun.tell(1, job='j1')
    at_work = replace(READY, job='j1', job_state='DEPOSITING')
    assert Runner().step(running, at_work, 0.0)[0].item(1).state == RUNNING
    assert Runner().step(running, CellView(), 0.0)[0].item(1).state == RUNNING
    ended = replace(at_work, job_state='FAILED', job_message='arc lost')
    assert Runner().step(running, ended, 0.0)[0].item(1).state == 'failed'
    for queue, view in ((running, READY), (begun, at_work)):
        assert Runner().step(queue, view, 0.0)[0].item(1).state == INTERRUPTED


def test_a_start_that_comes_to_nothing_ends():
    runner = Runner()
    runner.step(Queue(), READY, 0.0)
    queue, _ = runner.step(filled(1).release(1, 'Kim'), READY, 1.0)
    queue, _ = runner.step(queue, READY, SEEN_S)
    assert queue.item(1).state == RUNNING
    queue, _ = runner.step(queue, READY, SEEN_S + 2.0)
    assert queue.item(1).state == INTERRUPTED


# ---- any row of operations, with kills at any step of the file system

OPERATIONS = st.lists(
    st.tuples(
        st.sampled_from(['add', 'move', 'remove', 'release', 'hold', 'begin', 'back', 'finish', 'withdraw']),
        st.integers(1, 6),
        st.integers(1, 4),
        st.integers(0, 6),
    ),
    max_size=14,
)  # fmt: skip


def apply(queue: Queue, name: str, id: int, number: int) -> Queue:
    return {
        'add': lambda: queue.add({'part': f'{number}.stl'}, 'Ada', 1.0),
        'move': lambda: queue.move(id, number), 'remove': lambda: queue.remove(id),
        'release': lambda: queue.release(id, 'Kim'), 'hold': lambda: queue.hold(id),
        'begin': lambda: queue.begin(id), 'back': lambda: queue.back(id, 'no'),
        'finish': lambda: queue.finish(id, ENDED[number - 1]), 'withdraw': lambda: queue.withdraw('again'),
    }[name]()  # fmt: skip


class Model:
    """Plain lists and names of states, without the rules' code."""

    def __init__(self) -> None:
        self.state: dict[int, str] = {}
        self.waiting: list[int] = []
        self.last = 0

    def one(self, state: str) -> int:
        return next((i for i, s in self.state.items() if s == state), 0)

    def apply(self, name: str, id: int, number: int) -> bool:
        """False: refused."""
        now = self.state.get(id)
        if name == 'add':
            self.last += 1
            self._put(self.last, 'waiting', len(self.waiting))
        elif name == 'withdraw':
            id = self.one('released')
            if id:
                self._put(id, 'waiting', 0)
        elif name == 'move' and now == 'waiting' and number <= len(self.waiting):
            self._put(id, 'waiting', number - 1)
        elif name == 'remove' and now and now != 'running':
            self.waiting = [i for i in self.waiting if i != id]
            del self.state[id]
        elif (
            name == 'release'
            and now == 'waiting'
            and not self.one('released')
            and not self.one('running')
        ):
            self._put(id, 'released')
        elif name == 'hold' and now == 'released' or name == 'back' and now == 'running':
            self._put(id, 'waiting', 0)
        elif name == 'begin' and now == 'released':
            self._put(id, 'running')
        elif name == 'finish' and now == 'running':
            self._put(id, ENDED[number - 1])
        else:
            return False
        return True

    def _put(self, id: int, state: str, place: int = 0) -> None:
        self.waiting = [i for i in self.waiting if i != id]
        if state == 'waiting':
            self.waiting.insert(place, id)
        self.state[id] = state

    def same(self, queue: Queue) -> bool:
        states = {i.id: i.state for i in queue.items}
        return states == self.state and ids(queue) == self.waiting and queue.last == self.last


class Killed(BaseException):
    """The process is gone at this point."""


def dies_at(step: int):
    """Stands for the file system: the call number `step` is the last one, before or after which nothing happens."""
    left = [step]

    class Disk:
        O_WRONLY, O_CREAT, O_EXCL, O_RDONLY, O_RDWR, O_CLOEXEC = (
            os.O_WRONLY, os.O_CREAT, os.O_EXCL, os.O_RDONLY, os.O_RDWR, os.O_CLOEXEC,
        )  # fmt: skip
        close = staticmethod(os.close)

        def __getattr__(self, name: str):
            def call(*arguments, **more):
                left[0] -= 1
                if left[0] == 0:
                    raise Killed
                return getattr(os, name)(*arguments, **more)

            return call

    return Disk()


@settings(max_examples=60, deadline=None)
@given(OPERATIONS)
def test_any_row_of_operations_with_kills_equals_the_model(operations):
    model = Model()
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        file = QueueFile(Path(folder))
        for name, id, number, killed_at in operations:
            before = file.read()
            patch.setattr(durable, 'os', dies_at(killed_at))
            try:
                file.change(lambda q, n=name, i=id, k=number: apply(q, n, i, k))
                happened = True
            except QueueError:
                assert not model.apply(name, id, number)
                happened = False
            except Killed:
                happened = QueueFile(Path(folder)).read() != before
            patch.setattr(durable, 'os', os)
            if happened:
                assert model.apply(name, id, number)
            file = QueueFile(Path(folder))  # the next process
            assert model.same(file.read())


def test_kill_9_loses_nothing_that_was_told(tmp_path):
    """Whatever was told before the kill is there: every item of the queue, every entry of the audit log."""
    told_queue, told_audit = 0, (0, '')
    untold = 0  # entries that may be there although nobody was told: one of each writer since the last that was
    chance = random.Random(5)
    for _ in range(12):
        writer = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name('killed_writer.py')), str(tmp_path)],
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert writer.stdout
        lines = [writer.stdout.readline() for _ in range(chance.randint(1, 30))]
        writer.send_signal(signal.SIGKILL)
        lines += writer.stdout.readlines()
        writer.wait()
        untold += 1
        for line in lines:
            kind, *values = line.split() if line.endswith('\n') else ['']
            if kind == 'queue':
                told_queue = int(values[0])
            elif kind == 'audit' and len(values) == 2:
                told_audit, untold = (int(values[0]), values[1]), 1
        queue = QueueFile(tmp_path).read()
        assert queue.last in (told_queue, told_queue + 1)
        told_queue = queue.last
        assert [i.part for i in queue.items] == [f'{n}.stl' for n in range(1, queue.last + 1)]
    log = AuditLog(tmp_path, 'cell')
    log.write('after', 'tester', 'cli')
    found = log.verify(told_audit[1])
    assert found.good, found.problems
    assert told_audit[0] <= found.last_n - 1 <= told_audit[0] + untold


@settings(max_examples=150)
@given(st.one_of(st.text(max_size=200), st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda x: st.lists(x, max_size=3) | st.dictionaries(st.sampled_from(
        ['version', 'items', 'last', 'id', 'setup', 'state']), x, max_size=6), max_leaves=12).map(repr)))  # fmt: skip
def test_any_text_is_a_queue_or_a_queue_error(text):
    for t in (text, text.replace("'", '"')):
        with contextlib.suppress(QueueError):
            assert Queue.parse(Queue.parse(t).text()) == Queue.parse(t)


def test_a_damaged_queue_is_told_and_never_overwritten(tmp_path):
    (tmp_path / 'queue.json').write_text('{"version": 1, "items": [')
    file = QueueFile(tmp_path)
    with pytest.raises(QueueError, match='queue.json: not JSON'):
        file.change(lambda q: q.add({}, '', 0.0))
    assert (tmp_path / 'queue.json').read_text() == '{"version": 1, "items": ['
