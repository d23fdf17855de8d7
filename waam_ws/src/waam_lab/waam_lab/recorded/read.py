"""Recordings from disk: telemetry and temperatures of an MCAP, as arrays. What is missing in them stays NaN."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waam_node import cdr, job_folder
from waam_record.bag_copy import messages
from waam_record.bag_reader import bag_files
from waam_record.decode import Decoder

from ..twin.records import RecordError

TELEMETRY, TEMPERATURE = 'waam_msgs/msg/Telemetry', 'sensor_msgs/msg/Temperature'
COLUMNS = (
    'x',
    'y',
    'z',
    'travel_speed',
    'wire_feed_speed',
    'arc_current',
    'arc_voltage',
    'arc_established',
)


@dataclass(frozen=True)
class Recording:
    """t: (n,) s from the first row, rising; telemetry: column -> (n,) SI. curves: topic -> times (k,) s and
    temperatures (k,) degrees Celsius."""

    name: str
    t: np.ndarray
    telemetry: dict[str, np.ndarray]
    curves: dict[str, tuple[np.ndarray, np.ndarray]]


def is_recording(path: Path) -> bool:
    """An .mcap file, or a folder with some that is no job."""
    if path.is_file():
        return path.suffix == '.mcap'
    return path.is_dir() and any(path.glob('*.mcap')) and not (path / job_folder.MAPS).is_dir()


def is_wall(path: Path) -> bool:
    """A folder with laser profiles of a wall and the robot's log."""
    return path.is_dir() and any(path.glob('LaserCoordinate*.csv'))


def read(path: Path) -> Recording:
    """RecordError says what is missing."""
    frames: list[bytes] = []
    heat: dict[str, list[tuple[float, float]]] = {}
    decoder = Decoder()
    for topic, message in messages(bag_files(path)):
        if topic.type == TELEMETRY:
            frames.append(message.data)
        elif topic.type == TEMPERATURE:
            decoder.add(topic.type, topic.definition)
            one = decoder.message(topic.type, message.data)
            stamp = one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec
            heat.setdefault(topic.name, []).append((stamp, one.temperature))
    if not frames and not heat:
        raise RecordError(
            f'{path}: neither telemetry nor temperatures in it (logs of others: waam record import)'
        )
    try:
        stamps, rows = cdr.read_frames(frames)
    except ValueError as e:
        raise RecordError(f'{path}: {e}') from None
    stamps, first = np.unique(stamps, return_index=True)
    t = (stamps - stamps[0]) * 1e-9 if stamps.size else np.empty(0)
    telemetry = {name: np.asarray(rows[name][first], float) for name in COLUMNS}
    return Recording(path.name, t, telemetry, {k: _curve(v) for k, v in heat.items()})


def _curve(pairs: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    t, celsius = np.array(sorted(pairs)).T
    t, first = np.unique(t, return_index=True)
    good = np.isfinite(celsius[first])
    return t[good] - t[0], celsius[first][good]
