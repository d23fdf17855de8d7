"""Readers of recorded profiles and arc logs, and the map files. All returned is SI; errors name file and line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from waam_process.grid import GridError, GridSpec, HeightGrid

from .left_out import LeftOut, leave_out

LASER_HEADER = ['TimeReceived', 'X', 'Z', 'Intensity']
ARC_COLUMNS = ('x', 'y', 'z', 'speed', 'ArcOn', 'WFS', 'I', 'U')
INPROCESS_HEADER = ['Layer', 'ScanID', 'Timestamp', 'SensorTimestamp', 'PointNr', 'X', 'Z']
HOUR = 3600.0
SHORT = 0.1  # a profile with less than this share of the usual number of points is damaged


class FileError(ValueError):
    """A file that is missing, unreadable or not what it should be; the text names file, line and field."""


@dataclass(frozen=True)
class LaserScan:
    """n raw profiles of a line laser. NaN where a profile has fewer points than the longest."""

    stamps: np.ndarray  # (n,) int64 ns since 1970
    x: np.ndarray  # (n, m) m, lateral
    range: np.ndarray  # (n, m) m, distance from the sensor
    intensity: np.ndarray  # (n, m) as recorded


@dataclass(frozen=True)
class ArcLog:
    """What the robot logged, n lines."""

    t: np.ndarray  # (n,) s since the full hour before the first line, truncated to `quantum`
    position: np.ndarray  # (n, 3) m
    speed: np.ndarray  # (n,) m/s
    arc: np.ndarray  # (n,) bool
    wire_feed: np.ndarray  # (n,) m/s
    current: np.ndarray  # (n,) A
    voltage: np.ndarray  # (n,) V
    quantum: float = 0.1  # s


@dataclass(frozen=True)
class InprocessScan:
    """n profiles measured beside the arc."""

    layer: np.ndarray  # (n,) int
    t: np.ndarray  # (n,) s
    x: np.ndarray  # (n, m) m, NaN = no point
    z: np.ndarray  # (n, m) m


def read_text(path: Path) -> str:
    """UTF-8, with or without byte order mark. FileError names the file and what is wrong with it."""
    try:
        return Path(path).read_bytes().decode('utf-8-sig')
    except FileNotFoundError:
        raise FileError(f'{path}: no such file') from None
    except IsADirectoryError:
        raise FileError(f'{path}: is a folder, not a file') from None
    except (OSError, UnicodeDecodeError) as e:
        raise FileError(f'{path}: cannot be read: {e}') from None


def records(
    path: Path, header: list[str], left_out: LeftOut | None = None
) -> Iterator[tuple[int, list[str]]]:
    """(line number, fields) of a comma-separated file with any line ends, bare CR too; blank lines are skipped. Lines
    with another number of fields are an error, or go into left_out."""
    lines = re.split(r'\r\n|\r|\n', read_text(path))
    names = [f.strip() for f in lines[0].split(',')]
    if names[: len(header)] != header:
        raise FileError(f'{path}, line 1: header is {lines[0][:60]!r}, expected {",".join(header)}')
    for number, line in enumerate(lines[1:], 2):
        if line.strip():
            fields = line.split(',')
            if len(fields) != len(names):
                wrong = f'{path}, line {number}: {len(fields)} fields, the header has {len(names)}'
                leave_out(left_out, 'line', path, f'line {number}', FileError(wrong))
                continue
            yield number, fields


def numbers(path: Path, line: int, name: str, text: str) -> np.ndarray:
    """Space-separated numbers of one field, NaN allowed. FileError names file, line and field."""
    try:
        values = np.array(text.split(), float)
    except ValueError as e:
        raise FileError(f'{path}, line {line}, field {name}: {e}') from None
    if np.isinf(values).any():
        raise FileError(f'{path}, line {line}, field {name}: infinite value')
    return values


def stack(rows: list[np.ndarray]) -> np.ndarray:
    """(n, longest), NaN behind the end of shorter rows."""
    out = np.full((len(rows), max(len(r) for r in rows)), np.nan)
    for i, row in enumerate(rows):
        out[i, : len(row)] = row
    return out


def read_laser_csv(path: Path, left_out: LeftOut | None = None) -> LaserScan:
    """`LaserCoordinateN.csv`: TimeReceived,X,Z,Intensity with the points of a profile space-separated in mm.

    A damaged line is an error. With left_out it is left out by name, and so are profiles of less than a tenth of the
    usual number of points (one point, NaN only).
    """
    found: list[tuple[int, int, list[np.ndarray]]] = []
    for line, fields in records(path, LASER_HEADER, left_out):
        try:
            found.append((line, *_profile(path, line, fields)))
        except FileError as e:
            leave_out(left_out, 'profile', path, f'line {line}', e)
    if left_out is not None:
        found = _long_enough(path, found, left_out)
    if not found:
        raise FileError(f'{path}: no profile in it')
    x, z, intensity = (stack([rows[k] for _, _, rows in found]) for k in range(3))
    return LaserScan(np.array([f[1] for f in found], np.int64), x * 1e-3, z * 1e-3, intensity)


def _profile(path: Path, line: int, fields: list[str]) -> tuple[int, list[np.ndarray]]:
    """Stamp in ns, and X, Z, Intensity as they are."""
    stamp = _date_ns(path, line, fields[0])
    rows = [numbers(path, line, LASER_HEADER[k], fields[k]) for k in (1, 2, 3)]
    sizes = [len(r) for r in rows]
    if len(set(sizes)) != 1 or sizes[0] == 0:
        raise FileError(
            f'{path}, line {line}: X, Z and Intensity have {sizes} values, need equal numbers'
        )
    return stamp, rows


def _long_enough(
    path: Path, found: list[tuple[int, int, list[np.ndarray]]], left_out: LeftOut
) -> list[tuple[int, int, list[np.ndarray]]]:
    points = [int((np.isfinite(r[0]) & np.isfinite(r[1])).sum()) for _, _, r in found]
    usual = float(np.median(points)) if points else 0.0
    kept = []
    for one, n in zip(found, points, strict=True):
        if n >= max(2.0, SHORT * usual):
            kept.append(one)
            continue
        what = f'only {n} of the usual {usual:.0f} points' if n else 'not one point (NaN)'
        left_out.add('profile', path, f'line {one[0]}', what)
    return kept


def _date_ns(path: Path, line: int, text: str) -> int:
    try:
        stamp = datetime.fromisoformat(text.strip()).replace(tzinfo=UTC)
    except (ValueError, OverflowError):
        raise FileError(
            f'{path}, line {line}, field TimeReceived: {text[:40]!r} is not a date and time'
        ) from None
    return round(stamp.timestamp() * 1000) * 1_000_000


def read_arc_log(path: Path, left_out: LeftOut | None = None) -> ArcLog:
    """`arc_log.csv`: `time` as minute:second.tenth, position in mm, speed and WFS in m/min, I in A, U in V. A damaged
    line is an error; with left_out it is left out by name."""
    header = [f.strip() for f in re.split(r'[\r\n]', read_text(path), maxsplit=1)[0].split(',')]
    missing = [c for c in ('time', *ARC_COLUMNS) if c not in header]
    if missing:
        raise FileError(f'{path}, line 1: no column {", ".join(missing)}')
    at = {name: header.index(name) for name in ('time', *ARC_COLUMNS)}
    rows = []
    for line, fields in records(path, header, left_out):
        try:
            rows.append(_arc_line(path, line, fields, at))
        except FileError as e:
            leave_out(left_out, 'line', path, f'line {line}', e)
    if not rows:
        raise FileError(f'{path}: no line with data')
    a = np.array(rows)
    t = a[:, 0] + HOUR * np.cumsum(np.diff(a[:, 0], prepend=a[0, 0]) < -HOUR / 2)
    return ArcLog(
        t=t,
        position=a[:, 1:4] * 1e-3,
        speed=a[:, 4] / 60,
        arc=a[:, 5] != 0,
        wire_feed=a[:, 6] / 60,
        current=a[:, 7],
        voltage=a[:, 8],
    )


def _arc_line(path: Path, line: int, fields: list[str], at: dict[str, int]) -> list[float]:
    t = _minute_second(path, line, fields[at['time']])
    rest = [numbers(path, line, name, fields[at[name]]) for name in ARC_COLUMNS]
    if any(len(r) != 1 or np.isnan(r[0]) for r in rest):
        raise FileError(f'{path}, line {line}: a field is empty or not a number')
    return [t, *(float(r[0]) for r in rest)]


def _minute_second(path: Path, line: int, text: str) -> float:
    match = re.fullmatch(r'\s*(\d{1,2}):(\d{1,2}(?:\.\d+)?)\s*', text)
    if not match or int(match[1]) > 59 or float(match[2]) >= 60:
        raise FileError(
            f'{path}, line {line}, field time: {text[:40]!r} is not minute:second.tenth'
        )
    return 60.0 * int(match[1]) + float(match[2])


def read_inprocess_csv(path: Path, left_out: LeftOut | None = None) -> InprocessScan:
    """One point per line (Layer, ScanID, Timestamp in s, ..., X, Z in mm), grouped by layer and scan number. A damaged
    line is an error; with left_out it is left out by name."""
    groups: dict[tuple[int, int], list[np.ndarray]] = {}
    for line, f in records(path, INPROCESS_HEADER, left_out):
        try:
            key, point = _point(path, line, f)
        except FileError as e:
            leave_out(left_out, 'line', path, f'line {line}', e)
            continue
        groups.setdefault(key, []).append(point)
    if not groups:
        raise FileError(f'{path}: no point in it')
    blocks = [np.array(g) for g in groups.values()]
    return InprocessScan(
        layer=np.array([k[0] for k in groups]),
        t=np.array([b[0, 0] for b in blocks]),
        x=stack([b[:, 1] for b in blocks]) * 1e-3,
        z=stack([b[:, 2] for b in blocks]) * 1e-3,
    )


def _point(path: Path, line: int, f: list[str]) -> tuple[tuple[int, int], np.ndarray]:
    v = numbers(
        path, line, 'Layer, ScanID, Timestamp, X, Z', ' '.join((f[0], f[1], f[2], f[5], f[6]))
    )
    if len(v) != 5 or np.isnan(v).any():
        raise FileError(f'{path}, line {line}: Layer, ScanID, Timestamp, X and Z must be numbers')
    return (int(v[0]), int(v[1])), v[2:]


def save_map(
    path: Path,
    spec: GridSpec,
    z: np.ndarray,
    sigma: np.ndarray | None,
    count: np.ndarray,
    **more: Any,
) -> None:
    """NPZ as docs/job_folder.md has it: z, sigma (float32, m), count, origin (2,), resolution, and `more`."""
    with open(path, 'wb') as f:
        np.savez_compressed(
            f,
            z=np.asarray(z, np.float32),
            sigma=np.asarray(sigma, np.float32),
            count=count,
            origin=np.array([spec.origin_x, spec.origin_y]),
            resolution=np.array(spec.resolution),
            **more,
        )


def load_map(path: Path) -> HeightGrid:
    """A map written by `save_map` or by a job; FileError when it is none."""
    try:
        return HeightGrid.load_npz(path)
    except FileNotFoundError:
        raise FileError(f'{path}: no such file') from None
    except KeyError as e:
        raise FileError(f'{path}: not a height map: {e.args[0]}') from None
    except (GridError, ValueError, OSError, EOFError, TypeError, IndexError) as e:
        raise FileError(f'{path}: not a height map: {e}') from None
