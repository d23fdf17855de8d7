"""Files of a two-colour pyrometer: a head with date and time, then a table with tabs and decimal commas."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from .bag_writer import BagError, Topic
from .log_column import QOS, Column
from .standard import Standard

KEPT = {'TProc': 'process', 'TRatio': 'ratio', 'TWB': 'wide_band', 'TNB': 'narrow_band'}
KIND = 'sensor_msgs/msg/Temperature'


def is_pyrometer(path: Path) -> bool:
    """Whether a file begins as this device writes it."""
    try:
        with open(path, 'rb') as f:
            return f.read(4096).lstrip().startswith(b'[Connect DataFile]')
    except OSError:
        return False


def read_pyrometer(path: Path) -> list[Column]:
    """Temperatures (degrees Celsius) on one topic per channel. Date and time of the file are taken as UTC (it names no
    zone). BagError names file and line of what cannot be read."""
    lines = path.read_text(encoding='latin-1').splitlines()
    head: dict[str, str] = {}
    table = next((n for n, line in enumerate(lines) if line.startswith('Time\t')), None)
    if table is None:
        raise BagError(f"{path}: no table (a line that begins with 'Time' and a tab)")
    for line in lines[:table]:
        key, _, value = line.partition('\t')
        head[key.rstrip(':')] = value.strip()
    begin = _begin(path, head)
    names = lines[table].split('\t')
    stem = path.stem.lower()
    columns = []
    for name, short in KEPT.items():
        if name in names:
            topic = Topic(
                f'/{stem}/{short}', KIND, Standard.text(KIND), Standard.hash(KIND), (QOS,)
            )
            columns.append(Column(topic, _samples(path, lines, table, names.index(name), begin)))
    return columns


def _begin(path: Path, head: dict[str, str]) -> int:
    text = f'{head.get("Date", "")} {head.get("Time", "")}'
    try:
        moment = datetime.strptime(text, '%d.%m.%Y %H:%M:%S').replace(tzinfo=UTC)
    except ValueError:
        raise BagError(f"{path}: '{text}' is not a date and time") from None
    return int(moment.timestamp()) * 1_000_000_000


def _samples(
    path: Path, lines: list[str], table: int, i: int, begin: int
) -> list[tuple[int, bytes]]:
    made = []
    for n, line in enumerate(lines[table + 1 :], table + 2):
        if line.startswith(('---', 'End of File')) or not line.strip():
            continue
        cells = line.split('\t')
        try:
            stamp = begin + _elapsed(cells[0])
            made.append((stamp, Standard.temperature(stamp, float(cells[i].replace(',', '.')))))
        except (ValueError, IndexError):
            raise BagError(f"{path}, line {n}: '{line[:60]}' cannot be read") from None
    return made


def _elapsed(text: str) -> int:
    """'00:01:02,0300' in ns."""
    clock, _, fraction = text.partition(',')
    hours, minutes, seconds = (int(v) for v in clock.split(':'))
    return (hours * 3600 + minutes * 60 + seconds) * 1_000_000_000 + int(fraction.ljust(9, '0')[:9])
