"""The order of a lock-step replay: which telemetry and profiles belong before which question.

A map was made from the profiles that had arrived when its scan was closed. Their number is in the map, so exactly these
are given before `finish`, and telemetry up to the frame behind the last of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Channel, Message, Schema

from waam_node import cdr
from waam_record.bag_reader import bag_files
from waam_record.decode import Decoder
from waam_record.read_record import (
    GONE,
    REQUEST,
    RESPONSE,
    SERVICES,
    SUFFIX,
    ReplayError,
    refuse_gone,
)
from waam_record.salvage import records

Inputs = list[tuple[bool, bytes]]  # (is a batch of profiles, serialised message)


@dataclass
class Call:
    """A question: the recorded request event and answer event, ROS time at the server; profiles: in its map."""

    kind: str
    data: bytes
    at_ns: int
    ros_ns: int
    answer: bytes = b''
    answered_ns: int = 0
    profiles: int = 0
    until_ns: int = 0


@dataclass
class Step:
    """Give `inputs` in order, then ask `call` (None: nothing more is asked)."""

    inputs: Inputs = field(default_factory=list)
    call: Call | None = None


@dataclass
class _Tape:
    """Everything needed, by publication time."""

    telemetry: list[tuple[int, bytes]] = field(default_factory=list)
    # at, data, profiles, newest stamp
    batches: list[tuple[int, bytes, int, int]] = field(default_factory=list)
    calls: list[Call] = field(default_factory=list)


def steps(folder: Path) -> list[Step]:
    """Steps of a record. ReplayError when it holds no answered question."""
    tape = _read(folder)
    calls = [c for c in tape.calls if c.answer]
    if not calls:
        raise ReplayError(
            f'{folder}: holds no service events of the nodes (see waam_replay/README.md)'
        )
    stamps, _ = cdr.read_poses([data for _, data in tape.telemetry])
    made: list[Step] = []
    fed = batch = 0
    for call in calls:
        step = Step(call=call)
        chosen: list[tuple[int, bool, bytes]] = []
        needed = call.until_ns
        if call.kind == 'finish':
            profiles = 0
            while batch < len(tape.batches) and profiles < call.profiles:
                at, data, count, newest = tape.batches[batch]
                chosen.append((at, True, data))
                profiles, needed, batch = profiles + count, max(needed, newest), batch + 1
        elif call.kind == 'begin':  # what came too late for the map before
            while batch < len(tape.batches) and tape.batches[batch][0] < call.at_ns:
                batch += 1
        while fed < len(tape.telemetry) and (
            tape.telemetry[fed][0] < call.at_ns or (fed and stamps[fed - 1] < needed)
        ):
            chosen.append((tape.telemetry[fed][0], False, tape.telemetry[fed][1]))
            fed += 1
        chosen.sort(key=lambda item: item[0])
        step.inputs = [(is_profile, data) for _, is_profile, data in chosen]
        made.append(step)
    return made


def _read(folder: Path) -> _Tape:
    tape, decoder = _Tape(), Decoder()
    pending: dict[tuple, Call] = {}
    for file in bag_files(folder):
        schemas: dict[int, Schema] = {}
        takes: dict[int, tuple[str, str]] = {}
        for item in records(file):
            if isinstance(item, Schema):
                schemas[item.id] = item
            elif isinstance(item, Channel):
                if kind := _kind(item.topic):
                    schema = schemas[item.schema_id]
                    decoder.add(schema.name, schema.data.decode())
                    takes[item.id] = kind, schema.name
            elif isinstance(item, Message) and item.channel_id in takes:
                _take(tape, decoder, pending, *takes[item.channel_id], item)
    tape.telemetry.sort(key=lambda t: t[0])
    tape.batches.sort(key=lambda b: b[0])
    tape.calls.sort(key=lambda c: c.at_ns)
    return tape


def _kind(topic: str) -> str:
    last = topic.rpartition('/')[2]
    if last in ('telemetry', 'profiles'):
        return last
    if topic.endswith(GONE):
        return 'gone'
    return next((k for k, name in SERVICES.items() if topic.endswith(name + SUFFIX)), '')


def _take(
    tape: _Tape, decoder: Decoder, pending: dict[tuple, Call], kind: str, type_name: str, m: Message
) -> None:
    if kind == 'telemetry':
        tape.telemetry.append((m.publish_time, m.data))
        return
    if kind == 'gone':
        refuse_gone()
    msg = decoder.message(type_name, m.data)
    if kind == 'profiles':
        newest = msg.header.stamp.sec * 1_000_000_000 + msg.header.stamp.nanosec
        newest += int(max(msg.stamp_offsets_ns, default=0))
        tape.batches.append((m.publish_time, m.data, msg.profile_count, newest))
        return
    event = msg.info
    key = kind, bytes(event.client_gid), event.sequence_number
    if event.event_type == REQUEST and len(msg.request):
        ros_ns = event.stamp.sec * 1_000_000_000 + event.stamp.nanosec
        call = Call(kind, m.data, m.publish_time, ros_ns)
        if kind == 'finish':
            until = msg.request[0].until
            call.until_ns = until.sec * 1_000_000_000 + until.nanosec
        pending[key] = call
        tape.calls.append(call)
    elif event.event_type == RESPONSE and key in pending:
        call = pending.pop(key)
        call.answer, call.answered_ns = m.data, m.publish_time
        if kind == 'finish':
            found = msg.response[0].map
            call.profiles = found.profiles_used + found.profiles_rejected
