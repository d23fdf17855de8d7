"""The audit log as a chain: each entry holds the hash of the one before, so nothing can be changed, left out or moved
without breaking it. Pure: lines in, entries out; time is an argument.

hash_n = SHA-256(hash_{n-1} + entry_n as JSON with sorted keys, without `hash`); hash_0 is 64 zeros. The chain shows
what was changed inside. What was cut off at the end shows the head file, or a hash that was kept elsewhere.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from waam_process.rows import row_of

FIRST = '0' * 64
MAX_TEXT_LENGTH = 200  # letters of a text in an entry
LOOKED_AT = 2000  # letters of a text that are searched for secrets; the rest is cut off before
MAX_ENTRY_VALUES = 24  # values of one entry
LARGEST = (
    2**63
)  # from here on a whole number is told by its size: readers need not take longer ones
BYTES = 16 << 10  # of a line; what would make it longer is left out, and said
CUT = '…'
LEFT_OUT = '(left out)'  # name of the value that says how many are
SECRET_NAMES = re.compile(r'token|secret|passw|url|\bkey\b|csrf|cookie', re.IGNORECASE)
SECRET_TEXT = re.compile(r'waam_[0-9a-f]{8}_[A-Za-z0-9_-]{20,}|\b[a-z][a-z0-9+.-]*://\S+')
HIDDEN = '(hidden)'


class AuditError(ValueError):
    """A line that is no entry."""


@dataclass(frozen=True)
class Entry:
    """utc in s; who: name of a token, `local`, `cli:USER` or `cell`; via: panel, cli, queue, or cell for what it was
    seen to do; what: the command; outcome: asked, ok, refused, denied or seen; note: why. torn: hash of a line before
    that a power cut left unfinished. missing: how many entries the head file knows of that the log has no more."""

    n: int
    utc: float
    cell: str
    who: str
    role: str
    via: str
    what: str
    outcome: str
    data: dict[str, Any] = field(default_factory=dict, hash=False)
    note: str = ''
    torn: str = ''
    missing: int = 0
    prev: str = FIRST
    hash: str = ''

    def computed(self) -> str:
        """The hash that this entry must have."""
        content = {k: v for k, v in asdict(self).items() if k != 'hash'}
        text = json.dumps(content, sort_keys=True, separators=(',', ':'))
        return hashlib.sha256((self.prev + text).encode()).hexdigest()

    def line(self) -> str:
        """For the file, with its end."""
        return json.dumps(asdict(self), sort_keys=True, separators=(',', ':')) + '\n'


def parse(line: bytes) -> Entry:
    """One line without its end. Raises AuditError; never anything else, whatever the bytes are."""
    try:
        entry = row_of(Entry, json.loads(line.decode('utf-8'), parse_constant=_refuse))
        entry.computed()
    except (ValueError, RecursionError, TypeError):
        raise AuditError('no entry, or a value that cannot be hashed') from None
    return entry


def _refuse(constant: str) -> float:
    raise ValueError(constant)


def hidden(data: Mapping[str, Any]) -> dict[str, Any]:
    """What of a command's values goes into the log: short, and without secrets, by name and by form."""
    kept: dict[str, Any] = {}
    room = BYTES // 2  # the other half is for what an entry holds besides
    for name, value in data.items():
        key = _text(name)[:LOOKED_AT]
        told, key = HIDDEN if SECRET_NAMES.search(key) else _short(value), key[:40]
        room -= len(json.dumps({key: told}))
        if len(kept) == MAX_ENTRY_VALUES or room < 0:
            break
        kept[key] = told
    if len(kept) < len(data):
        kept[LEFT_OUT] = len(data) - len(kept)
    return kept


def _short(value: Any) -> Any:
    """A value that every reader takes."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, int):
        small = abs(value) < LARGEST
        return int(value) if small else f'whole number of {value.bit_length()} bits'
    if isinstance(value, float):
        return float(value) if abs(value) < 1e300 else str(value)
    return clean(_text(value))


def _text(value: Any) -> str:
    try:
        return str(value)
    except (ValueError, RecursionError, MemoryError):
        return f'{type(value).__name__} that cannot be shown'


def clean(text: str) -> str:
    """Without tokens and addresses, cut to MAX_TEXT_LENGTH with a mark where more followed."""
    told = SECRET_TEXT.sub(HIDDEN, text[:LOOKED_AT])
    return (
        told
        if len(told) <= MAX_TEXT_LENGTH and len(text) <= LOOKED_AT
        else told[: MAX_TEXT_LENGTH - 1] + CUT
    )


@dataclass
class Verdict:
    """entries: how many were read; problems: what is wrong, in order; torn: lines that a power cut left; last: hash of
    the last good entry."""

    entries: int = 0
    torn: int = 0
    last: str = FIRST
    last_n: int = 0
    problems: list[str] = field(default_factory=list)

    @property
    def good(self) -> bool:
        """Nothing was changed, left out or cut off."""
        return not self.problems


def verify(
    lines: Iterable[bytes], head: tuple[int, str] | None = None, expect: str = ''
) -> Verdict:
    """Walks the whole chain. lines: without their ends; the last one may be unfinished. head: number and hash that the
    head file has. expect: a hash that was kept elsewhere and must occur."""
    found = Verdict()
    pending: list[tuple[int, bytes]] = []
    seen_head, seen_expected = head is None or head[0] == 0, not expect
    for number, line in enumerate(lines, 1):
        try:
            entry = parse(line)
        except AuditError:
            if pending:
                _damaged(found, *pending.pop())
            pending.append((number, line))
            continue
        _link(found, number, entry, pending)
        seen_head |= head is not None and (entry.n, entry.hash) == head
        seen_expected |= entry.hash == expect
    if pending and pending[-1][1]:
        found.torn += 1  # the very last line: the power went while it was written
    if head is not None and not seen_head:
        cut = found.last_n < head[0]
        found.problems.append(
            f'cut off: the head file knows entry {head[0]}, the log ends with {found.last_n}'
            if cut else f'entry {head[0]} is another one than the head file knows'
        )  # fmt: skip
    if not seen_expected:
        found.problems.append(f'no entry has the hash {expect[:16]}...')
    return found


def _link(found: Verdict, number: int, entry: Entry, pending: list[tuple[int, bytes]]) -> None:
    where = f'line {number}'
    if pending:
        at, line = pending.pop()
        if entry.torn and entry.torn == hashlib.sha256(line).hexdigest():
            found.torn += 1
        else:
            _damaged(found, at, line)
    if entry.hash != entry.computed():
        found.problems.append(f'{where}: entry {entry.n} was changed')
    if entry.missing:
        found.problems.append(f'{where}: {entry.missing} entries before {entry.n} are missing')
    elif entry.prev != found.last or entry.n != found.last_n + 1:
        found.problems.append(f'{where}: entry {entry.n} does not follow entry {found.last_n}')
    found.entries += 1
    found.last, found.last_n = entry.hash, entry.n


def _damaged(found: Verdict, number: int, _line: bytes) -> None:
    found.problems.append(f'line {number}: damaged')
