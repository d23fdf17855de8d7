"""Reads a recording (MCAP) that has no job folder around it. What only the report knows, the verdict for one,
is NULL."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from waam_node import cdr, job_folder
from waam_process.loop_mode import with_loop_mode
from waam_process.names import JOB_STATES
from waam_process.safe_files import FileError, parse_yaml
from waam_record.bag_reader import bag_files, info
from waam_record.bag_writer import BagError
from waam_record.decode import DecodeError, Decoder
from waam_record.salvage import messages

from .beads import Paths, bead_rows
from .content import Content, Surface
from .folder_source import DEPOSIT, SourceError, hash_file, wire_of
from .rows import Told, all_rows
from .surfaces import add_counts
from .values import mapping, text

DECODED = (
    'job_status', 'layer_report', 'anomaly', 'layer_plan', 'height_map', 'correction_map', 'temperature',
)  # fmt: skip
RATE = 10.0  # rows of telemetry per second, as in telemetry.npz


@dataclass
class _Found:
    """Messages by topic, each with its time of publication (ns)."""

    messages: dict[str, list[tuple[int, Any]]] = field(
        default_factory=lambda: {k: [] for k in DECODED}
    )
    frames: list[bytes] = field(default_factory=list)
    first_ns: int = 0
    notes: list[str] = field(default_factory=list)


def is_record(path: Path) -> bool:
    """An .mcap file, or a folder with some."""
    return path.suffix == '.mcap' if path.is_file() else any(path.glob('*.mcap'))


def stamp_of(path: Path) -> str:
    """Names, sizes and times of the files of a recording."""
    facts = [(f.name, f.stat().st_size, f.stat().st_mtime_ns) for f in bag_files(path)]
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:32]


def content_hash(path: Path) -> str:
    """sha256 over names and contents of the files of a recording."""
    lines = (f'{f.name}\0{hash_file(f)}\n' for f in bag_files(path))
    return hashlib.sha256(''.join(lines).encode()).hexdigest()


def read(path: Path) -> Content:
    """A recording as the content of a job. SourceError when there is no job in it."""
    try:
        files = bag_files(path)
        custom = info(path).custom_data
    except (BagError, OSError, ValueError, AttributeError) as e:
        raise SourceError(f'{path}: {e}') from None
    found = _Found()
    for file in files:
        _read_file(file, found)
    job = _job_id(found, custom)
    if not job:
        raise SourceError(f'{path}: no job is recorded there (no message on job_status)')
    content = Content(
        job, content_hash(path), str(path.resolve()), stamp_of(path), notes=found.notes
    )
    _fill(content, found, _told(found, custom))
    return content


def _read_file(file: Path, found: _Found) -> None:
    seen: set[tuple[int, int, int]] = set()
    for channel, schema, m in messages(file, found.notes):
        found.first_ns = found.first_ns or m.log_time
        topic = channel.topic.rpartition('/')[2]
        if topic == 'telemetry':
            found.frames.append(m.data)
            continue
        key = m.channel_id, m.publish_time, m.sequence
        if topic not in DECODED or not schema.id or key in seen:  # a split repeats latched messages
            continue
        seen.add(key)
        try:
            decoder = _decoder(schema.name, schema.data)
            found.messages[topic].append((m.publish_time, decoder.message(schema.name, m.data)))
        except (DecodeError, UnicodeDecodeError) as e:
            found.notes.append(f'{topic}: a message was left out ({e})')


@lru_cache(maxsize=64)
def _decoder(name: str, definition: bytes) -> Decoder:
    """Of one type by one definition: reading a definition takes longer than reading a thousand messages."""
    decoder = Decoder()
    decoder.add(name, definition.decode())
    return decoder


def _job_id(found: _Found, custom: dict[str, str]) -> str:
    named = [m.job_id for _, m in found.messages['job_status'] if m.job_id]
    return job_folder.job_of(named[-1] if named else str(custom.get('job_id') or ''))


def _plain(message: Any) -> dict[str, Any]:
    """Fields of a message; numpy scalars as numbers."""
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in vars(message).items()}


def _stamp(message: Any) -> float:
    """s of the header."""
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def _told(found: _Found, custom: dict[str, str]) -> Told:
    """What a job folder would say, out of the messages."""
    asked_text = str(custom.get(job_folder.JOB) or '')
    try:
        asked = mapping(parse_yaml(asked_text, job_folder.JOB))
    except FileError:
        asked = {}
    last = found.messages['job_status'][-1:]
    status = with_loop_mode(_plain(last[0][1])) if last else {}
    code = int(status.get('state', 0))
    status['state'] = JOB_STATES[code] if 0 <= code < len(JOB_STATES) else None
    goal: dict[str, Any] = {
        **{k: status[k] for k in ('loop_mode', 'material') if k in status},
        **with_loop_mode(mapping(asked.get('goal'))),
    }
    layers = {(m.layer, m.final): _plain(m) for _, m in found.messages['layer_report']}
    anomalies = [_anomaly(m) for _, m in found.messages['anomaly']]
    seen = {'layers': list(layers.values()), 'anomalies': anomalies}
    return Told({**asked, 'goal': goal}, None, seen, status, asked_text=asked_text)


def _anomaly(message: Any) -> dict[str, Any]:
    p = message.position
    return {**_plain(message), 'time': _stamp(message), 'position': [p.x, p.y, p.z]}


def _fill(content: Content, found: _Found, told: Told) -> None:
    _, kg_per_m, kept = wire_of(told)
    content.rows = all_rows(content.job, told, kg_per_m, kept)
    content.telemetry = _telemetry(found)
    content.surfaces = _surfaces(found, content.notes)
    content.rows['beads'] = bead_rows(content.job, content.telemetry, _paths(found))
    job = content.rows['jobs'][0]
    job |= {'sha256': content.sha256, 'source': text(content.source), 'kind': 'record'}
    if job['created'] is None and found.first_ns:
        job['created'] = datetime.fromtimestamp(found.first_ns * 1e-9, UTC).replace(tzinfo=None)
    last = [r for r in content.rows['layers'] if r['final'] and r['height_error_rms_m'] is not None]
    if last:
        job['rms_mm'] = last[-1]['height_error_rms_m'] * 1e3
    add_counts(job, content.rows['beads'])


def _telemetry(found: _Found) -> dict[str, np.ndarray]:
    """Columns of telemetry.npz at RATE; layer and temperature are the last ones published before."""
    try:
        stamps, f = cdr.read_frames(found.frames)
    except ValueError as e:
        found.notes.append(f'telemetry: left out ({e})')
        return {}
    if not len(stamps):
        return {}
    chosen = _thinned(stamps)
    t, f = stamps[chosen] * 1e-9, f[chosen]
    status = [(_stamp(m), m.layer) for _, m in found.messages['job_status']]
    heat = [(_stamp(m), m.temperature) for _, m in found.messages['temperature']]
    return {
        't': t, 'x': f['x'], 'y': f['y'], 'z': f['z'], 'current': f['arc_current'], 'voltage': f['arc_voltage'],
        'wire_feed': f['wire_feed_speed'], 'wire_feed_commanded': f['wire_feed_commanded'],
        'speed': f['travel_speed'], 'temperature': _held(t, heat, np.nan),
        'arc': f['arc_established'].astype(float), 'layer': _held(t, status, 0.0),
    }  # fmt: skip


def _thinned(stamps: np.ndarray) -> np.ndarray:
    """Indices of the first frame of every tenth of a second, in the order of time."""
    order = np.argsort(stamps, kind='stable')
    slot = stamps[order] // int(1e9 / RATE)
    return order[np.flatnonzero(np.diff(slot, prepend=slot[0] - 1))]


def _held(t: np.ndarray, values: list[tuple[float, float]], before: float) -> np.ndarray:
    """Value of the last entry at or before each t; `before` where there is none."""
    if not values:
        return np.full(len(t), before)
    values = sorted(values)
    at = np.searchsorted([v[0] for v in values], t, side='right')
    return np.concatenate([[before], [float(v[1]) for v in values]])[at]


def _paths(found: _Found) -> Paths:
    segments: dict[tuple[int, int], Any] = {}
    for _, plan in found.messages['layer_plan']:
        segments |= {(s.layer, s.index): s for s in plan.segments if s.kind == DEPOSIT}
    if not segments:
        return Paths.none()
    laid = list(segments.values())
    ends = [[(p.x, p.y, p.z) for p in (s.start, s.end)] for s in laid]
    place = np.array(ends, float)
    numbers = np.array([(s.layer, s.bead) for s in laid], int)
    return Paths(numbers[:, 0], numbers[:, 1], place[:, 0], place[:, 1])


def _surfaces(found: _Found, notes: list[str]) -> list[Surface]:
    """Height maps by layer (the last one counts), with the correction that was computed from them."""
    surfaces: dict[int, Surface] = {}
    for topic, names, shift in (
        ('height_map', ('z', 'sigma', 'count'), 0),
        ('correction_map', ('psi', 'confidence', 'residual_height'), 1),
    ):
        for _, m in found.messages[topic]:
            try:
                _add_maps(surfaces, m, names, int(m.layer) - shift)
            except ValueError as e:
                notes.append(f'{topic} of layer {m.layer}: left out ({e})')
    return [surfaces[k] for k in sorted(surfaces)]


def _add_maps(surfaces: dict[int, Surface], m: Any, names: tuple[str, ...], layer: int) -> None:
    shape = int(m.grid.rows), int(m.grid.cols)
    origin = float(m.grid.origin.position.x), float(m.grid.origin.position.y)
    maps = {n: v.reshape(shape) for n in names if (v := np.asarray(getattr(m, n))).size}
    surface = surfaces.setdefault(layer, Surface(layer, origin, float(m.grid.resolution)))
    surface.arrays.update(maps)
