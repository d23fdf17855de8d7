"""CSV logs: one row per sample, a column with time stamps, columns with numbers.

What is known of a column's name decides its type: joint positions become sensor_msgs/JointState, temperatures
sensor_msgs/Temperature, everything else std_msgs/Float64 on a topic of its own, in SI units.
"""

from __future__ import annotations

import ast
import csv
import math
import re
from collections.abc import Callable
from pathlib import Path

from .bag_writer import BagError, Topic
from .log_column import QOS, Column
from .standard import Standard

STAMPS = ('rosbagtimestamp', 'timestamp', 'time', 'stamp', 't', '%time')
IGNORED = {'header', 'seq', 'stamp', 'frame_id', 'name', 'secs', 'nsecs'}
M_MIN = 1.0 / 60.0
NAMES: dict[str, tuple[str, float]] = {  # column -> topic and factor to SI
    'voltage': ('arc_voltage', 1.0),
    'current': ('arc_current', 1.0),
    'wfs': ('wire_feed_speed', M_MIN),
}


def read_csv(path: Path) -> list[Column]:
    """Topics of one file, below its name. BagError names file and line of what cannot be read."""
    with open(path, newline='', encoding='utf-8-sig', errors='replace') as f:
        rows = list(csv.reader(f, skipinitialspace=True))
    if len(rows) < 2:
        raise BagError(f'{path}: a header and at least one row are needed')
    heads = [h.strip() for h in rows[0]]
    time_of = _time_reader(path, heads)
    body = [(n, row) for n, row in enumerate(rows[1:], 2) if any(c.strip() for c in row)]
    stamps = [time_of(n, row) for n, row in body]
    stem = re.sub(r'\W+', '_', path.stem).strip('_').lower()
    if 'position' in heads or any(re.fullmatch(r'- joint_\d+', h) for h in heads):
        return [_joints(path, f'/{stem}/joint_states', heads, body, stamps)]
    columns = [
        _floats(f'/{stem}/{topic}', i, factor, body, stamps)
        for i, topic, factor in _number_columns(heads, body)
    ]
    if not columns:
        raise BagError(f'{path}: no column with numbers')
    return columns


def _time_reader(path: Path, heads: list[str]) -> Callable[[int, list[str]], int]:
    """Stamps in ns: header time (secs, nsecs) when there is one, else the first column that is called like a time."""
    lower = [h.lower() for h in heads]
    if 'secs' in lower and 'nsecs' in lower:
        s, ns = lower.index('secs'), lower.index('nsecs')
        return lambda n, row: _whole(path, n, row, s) * 1_000_000_000 + _whole(path, n, row, ns)
    at = next((lower.index(name) for name in STAMPS if name in lower), None)
    if at is None:
        raise BagError(f'{path}: no column with time; known are {", ".join(STAMPS)}')
    return lambda n, row: _stamp(path, n, row, at)


def _cell(path: Path, n: int, row: list[str], i: int) -> str:
    if i >= len(row):
        raise BagError(f'{path}, line {n}: {len(row)} cells, at least {i + 1} are needed')
    return row[i].strip()


def _whole(path: Path, n: int, row: list[str], i: int) -> int:
    text = _cell(path, n, row, i)
    try:
        return int(text)
    except ValueError:
        raise BagError(f"{path}, line {n}: '{text}' is not a time stamp") from None


def _stamp(path: Path, n: int, row: list[str], i: int) -> int:
    """Nanoseconds since 1970 as they are, anything smaller as seconds."""
    text = _cell(path, n, row, i)
    try:
        return int(text) if text.isdigit() and len(text) > 12 else round(float(text) * 1e9)
    except (ValueError, OverflowError):
        raise BagError(f"{path}, line {n}: '{text}' is not a time stamp") from None


def _number_columns(heads: list[str], body: list) -> list[tuple[int, str, float]]:
    found = []
    for i, head in enumerate(heads):
        name = head.lower()
        if not name or name in IGNORED or name in STAMPS:
            continue
        if not any(i < len(row) and not math.isnan(_number(row[i])) for _, row in body):
            continue
        topic, factor = NAMES.get(
            name, (re.sub(r'\W+', '_', name).strip('_') or f'column_{i}', 1.0)
        )
        found.append((i, topic, factor))
    return found


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _floats(name: str, i: int, factor: float, body: list, stamps: list[int]) -> Column:
    kind = 'std_msgs/msg/Float64'
    topic = Topic(name, kind, Standard.text(kind), Standard.hash(kind), (QOS,))
    samples = []
    for (_, row), stamp in zip(body, stamps, strict=True):
        value = _number(row[i]) if i < len(row) else math.nan
        if not math.isnan(value):
            samples.append((stamp, Standard.float64(value * factor)))
    return Column(topic, samples)


def _joints(path: Path, name: str, heads: list[str], body: list, stamps: list[int]) -> Column:
    """Positions as a list in one cell; names from columns like '- joint_1'."""
    joints = [h.removeprefix('- ') for h in heads if h.startswith('- ')]
    samples = []
    for (n, row), stamp in zip(body, stamps, strict=True):
        values = next((v for v in map(_list, row) if v), None)
        if values is None:
            raise BagError(f'{path}, line {n}: no list of joint positions')
        names = (
            joints if len(joints) == len(values) else [f'joint_{k + 1}' for k in range(len(values))]
        )
        samples.append((stamp, Standard.joint_state(stamp, names, values)))
    kind = 'sensor_msgs/msg/JointState'
    return Column(Topic(name, kind, Standard.text(kind), Standard.hash(kind), (QOS,)), samples)


def _list(cell: str) -> list[float] | None:
    """Numbers of a cell like '[0.05, -0.05]'; None for anything else."""
    cell = cell.strip()
    if not (cell.startswith('[') and cell.endswith(']')):
        return None
    try:
        return [float(v) for v in ast.literal_eval(cell)]
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return None
