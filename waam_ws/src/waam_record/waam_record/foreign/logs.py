"""Logs of others as one recording: read, propose a mapping, or go by one that was given."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ..bag_writer import BagError
from ..log_column import Column
from .apply import imported, stamps_of
from .mapping import FileMap, map_for, written
from .propose import propose, together
from .tally import Tally
from .text import Table, read_table

MAX_LOG_BYTES = 1 << 30  # bytes of a log


@dataclass
class Log:
    """A file with its table and its map."""

    path: Path
    table: Table
    map: FileMap


def read_logs(paths: list[Path], mapping: dict[str, FileMap] | None, name: str) -> list[Log]:
    """mapping: None = one is proposed. BagError names what cannot be read."""
    logs = []
    for path in paths:
        data = _bytes(path)
        given = None if mapping is None else map_for(mapping, path.name, name)
        table = read_table(data, str(path), None if given is None else given.form)
        logs.append(Log(path, table, given or propose(table)))
    if mapping is None:
        found = together({log.path.name: log.map for log in logs}, *_firsts(logs))
        for log in logs:
            log.map = found[log.path.name]
    return logs


def _bytes(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_LOG_BYTES:
            raise BagError(f'{path}: larger than {MAX_LOG_BYTES >> 30} GiB')
        return path.read_bytes()
    except OSError as e:
        raise BagError(f'{path}: {e.strerror or e}') from None


def _firsts(logs: list[Log]) -> tuple[dict[str, int], dict[str, int]]:
    """First stamps (ns) of the files that have a date, and of the others since their start."""
    dates, clocks = {}, {}
    for log in logs:
        start = log.map.time.start_ns
        stamps, _ = stamps_of(log.table, log.map, Tally()) if log.map.time.column else ([], [])
        if stamps and start:
            clocks[log.path.name] = stamps[0] - start
        elif stamps:
            dates[log.path.name] = min(stamps)
    return dates, clocks


def proposal(logs: list[Log]) -> str:
    """The mapping file."""
    return written({log.path.name: log.map for log in logs})


def open_points(logs: list[Log]) -> list[str]:
    """What of a proposal must be looked at, in a few lines."""
    found = []
    for log in logs:
        notes = log.map.notes
        guessed = sum('GUESSED' in note for note in notes.values())
        silent = [
            k.removeprefix('column ') for k, note in notes.items() if 'NOT UNDERSTOOD' in note
        ]
        if guessed:
            found.append(f'{log.path.name}: {guessed} entries are guessed, each is marked')
        if silent:
            found.append(f'{log.path.name}: not understood: {", ".join(silent)}')
    return found


def make(logs: list[Log]) -> tuple[list[Column], list[str]]:
    """Topics of all files, and what is said about them. Two files may give one topic when one begins after the other
    has ended, and profiles at any time; BagError otherwise."""
    found: dict[str, Column] = {}
    spans: dict[str, list[tuple[int, int, Path]]] = {}
    told: list[str] = []
    for log in logs:
        made = imported(log.table, log.map, str(log.path), _stem(log.path))
        for c in made.columns:
            name, new = c.topic.name, list(c.messages)
            stamps = [t for t, _ in new]
            low, high = min(stamps), max(stamps)
            for a, b, other in spans.get(name, []):
                if name != '/profiles' and low <= b and a <= high:
                    raise BagError(
                        f'{name} comes from {other} and from {log.path} at the same time: import them one by one, or '
                        'make the columns numbers (`{is: number}`) in one of them'
                    )
            spans.setdefault(name, []).append((low, high, log.path))
            before = list(found[name].messages) if name in found else []
            found[name] = Column(c.topic, [*before, *new])
        told += [made.told[0], *(f'  {line}' for line in made.told[1:])]
    return list(found.values()), told


def _stem(path: Path) -> str:
    """The first part of its topics."""
    stem = re.sub(r'\W+', '_', path.stem, flags=re.ASCII).strip('_').lower() or 'log'
    return f'log_{stem}' if stem[0].isdigit() else stem
