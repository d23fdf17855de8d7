"""A recorded job as the offline replay needs it: what was measured, what was asked, what was answered, in the order of
publication."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from mcap.records import Message, Schema

from waam_node import cdr, job_folder
from waam_process.loop_mode import with_loop_mode
from waam_process.safe_files import FileError, parse_json

from .bag_reader import bag_files, info
from .decode import Decoder, check_layout
from .salvage import messages

REQUEST, RESPONSE = 1, 2  # ServiceEventInfo: received by, sent by the server
SERVICES = {
    'begin': 'scan_fusion/begin',
    'finish': 'scan_fusion/finish',
    'correct': 'correction_server/compute',
    'feed': 'feed_forward/compute',
}
SUFFIX = '/_service_event'
GONE = 'correction_server/renew' + SUFFIX  # of versions that corrected a layer while it was laid


class ReplayError(ValueError):
    """A recording that cannot be computed again; the text says what is missing."""


def refuse_gone() -> NoReturn:
    """A record of a version that corrected a layer while it was laid: raises ReplayError."""
    raise ReplayError(
        'a layer of this job was corrected while it was laid (correction_server/renew), which this version does not '
        'compute: replay it with the version that recorded it (job.yaml names it; docs/upgrading.md)'
    )


@dataclass
class Exchange:
    """One call of a service. Times in ns."""

    request: Any
    at_ns: int  # publication of the request event, wall time
    ros_ns: int  # ROS time at the server
    response: Any = None
    answered_ns: int = 0  # publication of the answer


@dataclass
class Record:
    """Everything of one recording that is computed again or compared."""

    path: Path
    stamps: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))  # ns of the telemetry
    positions: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))  # m, telemetry
    batches: list[tuple[int, bytes]] = field(default_factory=list)  # publication time, ProfileBatch
    calls: dict[str, list[Exchange]] = field(default_factory=lambda: {k: [] for k in SERVICES})
    estimates: list[Any] = field(default_factory=list)
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    loop_mode: str = ''
    first_ns: int = 0  # of all messages
    last_ns: int = 0  # of all messages
    damage: list[str] = field(default_factory=list)

    @property
    def duration(self) -> float:
        """Machine time from the first to the last message in s (log time: ROS time of the graph)."""
        return (self.last_ns - self.first_ns) * 1e-9


def record_folder(path: Path) -> Path:
    """The recording of a job folder (`record`), or the folder itself. ReplayError when there is none."""
    path = Path(path)
    for folder in (path / job_folder.record(), path):
        if folder.is_file() or list(folder.glob('*.mcap')):
            return folder
    raise ReplayError(
        f'{path}: no record there (a job folder or a folder with .mcap files is wanted)'
    )


def load(path: Path, tick: Callable[[int], None] = lambda n: None) -> Record:
    """Reads a job or record folder once. ReplayError when it holds no scan, BagError when there is no file."""
    folder = record_folder(path)
    record = Record(folder)
    reader = _Reader(record, tick)
    for file in bag_files(folder):
        reader.read(file)
    reader.finish()
    custom = info(folder).custom_data
    record.loop_mode = with_loop_mode(custom).get('loop_mode', '')
    for key, text in custom.items():
        kind, _, node = key.partition('.')
        if kind == 'parameters':
            record.parameters[node] = _parameters(folder, key, text)
    if not record.calls['finish']:
        raise ReplayError(
            f'{folder}: holds no call of scan_fusion/finish. Service events are needed '
            '(records made before they existed, or of some topics only, lack them)'
        )
    return record


def _parameters(folder: Path, key: str, text: str) -> dict[str, Any]:
    try:
        found = parse_json(text, key, finite=False)
    except (FileError, AttributeError) as e:
        raise ReplayError(f'{folder}: {e}') from None
    if not isinstance(found, dict):
        raise ReplayError(f'{folder}: {key} holds no parameters')
    return found


Take = Callable[[Message, str], None]  # a message, and the name of its type


class _Reader:
    """Sorts the messages of the files into a `Record`."""

    def __init__(self, record: Record, tick: Callable[[int], None]) -> None:
        self.record, self.tick = record, tick
        self.decoder = Decoder()
        self._frames: list[tuple[int, bytes]] = []
        self._open: dict[tuple[str, int], Exchange] = {}
        self._seen: set[tuple[str, int, int]] = set()

    def read(self, file: Path) -> None:
        takes: dict[int, Take | None] = {}
        first, last, count = self.record.first_ns, self.record.last_ns, 0
        for channel, schema, m in messages(file, self.record.damage):
            count += 1
            first, last = min(first or m.log_time, m.log_time), max(last, m.log_time)
            if channel.id not in takes:
                takes[channel.id] = self._take(channel.topic.lstrip('/'), schema)
            if take := takes[channel.id]:
                take(m, schema.name)
        self.record.first_ns, self.record.last_ns = first, last
        self.tick(count)

    def _take(self, name: str, schema: Schema) -> Take | None:
        """What becomes of the messages of a topic; None: nothing."""
        last = name.rpartition('/')[2]
        raw = {'telemetry': self._frames, 'profiles': self.record.batches}
        if (kept := raw.get(last)) is not None:
            check_layout(schema.name, schema.data)
            return lambda m, _: kept.append((m.publish_time, m.data))
        if name.endswith(GONE):
            return lambda m, _: refuse_gone()
        event = next((k for k, v in SERVICES.items() if name.endswith(v + SUFFIX)), None)
        take = self._estimate if last == 'process_estimate' else event and self._event(event)
        if take:
            self.decoder.add(schema.name, schema.data.decode())
        return take or None

    def _repeated(self, m: Message, name: str) -> bool:
        """Whether a split repeated this latched message."""
        key = name, m.publish_time, m.sequence
        known = key in self._seen
        self._seen.add(key)
        return known

    def _estimate(self, m: Message, name: str) -> None:
        if not self._repeated(m, name):
            self.record.estimates.append(self.decoder.message(name, m.data))

    def _event(self, key: str) -> Take:
        def take(m: Message, name: str) -> None:
            event = self.decoder.message(name, m.data)
            call_id = bytes(event.info.client_gid).hex() + key, event.info.sequence_number
            stamp = event.info.stamp
            if event.info.event_type == REQUEST and len(event.request):
                ros_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
                exchange = Exchange(event.request[0], m.publish_time, ros_ns)
                self._open[call_id] = exchange
                self.record.calls[key].append(exchange)
            elif event.info.event_type == RESPONSE and call_id in self._open:
                exchange = self._open.pop(call_id)
                exchange.response, exchange.answered_ns = event.response[0], m.publish_time

        return take

    def finish(self) -> None:
        record = self.record
        self._frames.sort(key=lambda f: f[0])
        record.stamps, record.positions = cdr.read_poses([data for _, data in self._frames])
        record.batches.sort(key=lambda b: b[0])
        for calls in record.calls.values():
            calls.sort(key=lambda c: c.at_ns)
