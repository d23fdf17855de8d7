"""The queue of jobs of one cell. Pure: a queue goes in, another one comes out; times and names are arguments.

Nothing starts by itself. An item waits until an operator releases it: the release says that its part lies on the
table now. So there is one release at a time, it is worth one start, and it is withdrawn when anything else happens
first: the panel starts again, or another job is started by hand.
"""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from waam_process.rows import RowError, row_of
from waam_process.safe_files import FileError, parse_json

WAITING, RELEASED, RUNNING = 'waiting', 'released', 'running'
DONE, FAILED, ABORTED, INTERRUPTED = 'done', 'failed', 'aborted', 'interrupted'
OPEN = (WAITING, RELEASED, RUNNING)
ENDED = (DONE, FAILED, ABORTED, INTERRUPTED)
VERSION = 1
KEPT = 50  # ended items that stay in the list
MAX_OPEN_ITEMS = 1000  # open items
MAX_NOTE_LENGTH = 300  # letters of a note


class QueueError(ValueError):
    """What is asked of the queue cannot be; the text says why."""


@dataclass(frozen=True)
class Item:
    """setup: fields of the panel's form; sha256: of the file; added: UTC, s; note: why it waits or ended."""

    id: int
    setup: dict[str, Any] = field(hash=False)
    state: str = WAITING
    by: str = ''
    added: float = 0.0
    sha256: str = ''
    released_by: str = ''
    job: str = ''
    note: str = ''

    @property
    def part(self) -> str:
        """Name of the file: of a part, or of a program of another slicer."""
        return str(self.setup.get('part') or self.setup.get('program') or '')


@dataclass(frozen=True)
class Queue:
    """items: in the order in which they will be started; ended ones stand before the open ones. last: highest id."""

    items: tuple[Item, ...] = ()
    last: int = 0

    # ---- questions

    def unfinished(self) -> tuple[Item, ...]:
        """Items that have not ended."""
        return tuple(i for i in self.items if i.state in OPEN)

    def item(self, id: int) -> Item:
        """Raises QueueError when there is none."""
        for item in self.items:
            if item.id == id:
                return item
        raise QueueError(f'there is no item {id} in the queue')

    def in_state(self, state: str) -> Item | None:
        """The item in this state: of RELEASED and RUNNING there is one at most."""
        return next((i for i in self.items if i.state == state), None)

    # ---- what operators do

    def add(self, setup: dict[str, Any], by: str, now: float, sha256: str = '') -> Queue:
        """A new item at the end; its id is `last`."""
        if len(self.unfinished()) >= MAX_OPEN_ITEMS:
            raise QueueError(f'{MAX_OPEN_ITEMS} items wait already')
        item = Item(self.last + 1, setup, WAITING, by, now, sha256)
        return Queue((*self.items, item), item.id)

    def remove(self, id: int) -> Queue:
        """Takes an item out; not one that runs."""
        if self.item(id).state == RUNNING:
            raise QueueError(f'item {id} runs; stop the job first')
        return replace(self, items=tuple(i for i in self.items if i.id != id))

    def move(self, id: int, place: int) -> Queue:
        """place: 1 = the next one of those that wait."""
        item = self._waiting(id, 'moved')
        others = [i for i in self.items if i.state == WAITING and i.id != id]
        if not 1 <= place <= len(others) + 1:
            raise QueueError(f'place {place}, must be 1 to {len(others) + 1}')
        rest = [i for i in self.items if i.state != WAITING]
        return replace(self, items=(*rest, *others[: place - 1], item, *others[place - 1 :]))

    def release(self, id: int, by: str) -> Queue:
        """The part of this item lies on the table: it may start, once. It goes before those that wait."""
        item = self._waiting(id, 'released')
        for state in (RUNNING, RELEASED):
            other = self.in_state(state)
            if other:
                raise QueueError(
                    f'item {other.id} is {state}; a release is for the part that lies on the table now'
                )
        released = replace(item, state=RELEASED, released_by=by, note='')
        ended = [i for i in self.items if i.state in ENDED]
        waiting = [i for i in self.items if i.state == WAITING and i.id != id]
        return replace(self, items=(*ended, released, *waiting))

    def hold(self, id: int, note: str = '') -> Queue:
        """Withdraws a release."""
        item = self.item(id)
        if item.state != RELEASED:
            raise QueueError(f'item {id} is {item.state}, not released')
        return self._put(replace(item, state=WAITING, released_by='', note=note[:MAX_NOTE_LENGTH]))

    # ---- what happens

    def begin(self, id: int) -> Queue:
        """The start of a released item, written before the cell is asked: a kill in between never starts it twice."""
        item = self.item(id)
        if item.state != RELEASED:
            raise QueueError(f'item {id} is {item.state}, not released')
        return self._put(replace(item, state=RUNNING, note=''))

    def tell(self, id: int, job: str = '', note: str = '') -> Queue:
        """Name of the job's folder, and what the item waits for."""
        item = self.item(id)
        return self._put(replace(item, job=job or item.job, note=note[:MAX_NOTE_LENGTH]))

    def back(self, id: int, note: str) -> Queue:
        """A start that the cell refused: the item waits again, without its release."""
        item = self._running(id)
        return self._put(replace(item, state=WAITING, released_by='', note=note[:MAX_NOTE_LENGTH]))

    def finish(self, id: int, state: str, note: str = '') -> Queue:
        """The end of a running item. state: one of ENDED. The oldest ended items are forgotten."""
        if state not in ENDED:
            raise QueueError(f'{state!r} is no end of a job')
        queue = self._put(replace(self._running(id), state=state, note=note[:MAX_NOTE_LENGTH]))
        ended = [i for i in queue.items if i.state in ENDED]
        gone = {i.id for i in ended[: max(0, len(ended) - KEPT)]}
        return replace(queue, items=tuple(i for i in queue.items if i.id not in gone))

    def withdraw(self, note: str) -> Queue:
        """Every release is withdrawn: of a panel that starts again, or when another job was started."""
        released = self.in_state(RELEASED)
        return self.hold(released.id, note) if released else self

    # ---- files

    @classmethod
    def parse(cls, text: str) -> Queue:
        """From the text of the file. Raises QueueError; never anything else, whatever the text is."""
        try:
            data = parse_json(text, 'queue')
        except FileError:
            raise QueueError('not JSON') from None
        if not isinstance(data, dict) or data.get('version') != VERSION:
            raise QueueError(f'not a queue of version {VERSION}')
        rows, last = data.get('items'), data.get('last')
        if not isinstance(rows, list) or not isinstance(last, int) or isinstance(last, bool):
            raise QueueError('items must be a list and last a number')
        items = tuple(_item(row) for row in rows)
        ids = [i.id for i in items]
        if len(set(ids)) != len(ids) or max(ids, default=0) > last:
            raise QueueError('ids are not unique')
        for state in (RUNNING, RELEASED):
            if sum(i.state == state for i in items) > 1:
                raise QueueError(f'two items are {state}')
        return cls(items, last)

    def text(self) -> str:
        """For the file."""
        rows = [asdict(i) for i in self.items]
        return json.dumps({'version': VERSION, 'last': self.last, 'items': rows}, indent=1) + '\n'

    def _put(self, item: Item) -> Queue:
        return replace(self, items=tuple(item if i.id == item.id else i for i in self.items))

    def _waiting(self, id: int, done: str) -> Item:
        item = self.item(id)
        if item.state != WAITING:
            raise QueueError(f'item {id} is {item.state}; only one that waits can be {done}')
        return item

    def _running(self, id: int) -> Item:
        item = self.item(id)
        if item.state != RUNNING:
            raise QueueError(f'item {id} is {item.state}, not running')
        return item


_SHA = re.compile(r'[0-9a-f]{64}|')


def _item(row: Any) -> Item:
    try:
        item = row_of(Item, row)
    except RowError as e:
        raise QueueError(f'an item: {e}') from None
    if item.state not in (*OPEN, *ENDED):
        raise QueueError(f'an item has the state {item.state[:20]!r}')
    if item.id < 1 or not _SHA.fullmatch(item.sha256):
        raise QueueError('an item: id or hash cannot be')
    return item
