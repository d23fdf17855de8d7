"""The order of a lock-step replay: which telemetry and profiles belong before which question.

A map was made from the profiles that had arrived when its scan was closed. Their number is in the map, so exactly these
are given before `finish`, and telemetry up to the frame behind the last of them.
"""

from __future__ import annotations

from dataclasses import dataclass

from waam_node.conversions import nanoseconds
from waam_record.read_record import Exchange, Record, ReplayError
from waam_scan.stream.profiles import read_batch


@dataclass
class Step:
    """Give `inputs` (is a batch of profiles, serialised message) in order, then ask `call`."""

    inputs: list[tuple[bool, bytes]]
    call: Exchange


def steps(record: Record) -> list[Step]:
    """Steps of a record. ReplayError when it holds no answered question."""
    calls = [c for group in record.calls.values() for c in group if c.answer]
    if not calls:
        raise ReplayError(
            f'{record.path}: holds no service events of the nodes (see waam_replay/README.md)'
        )
    made: list[Step] = []
    fed = batch = 0
    frames, stamps, batches = record.frames, record.stamps, record.batches
    for call in sorted(calls, key=lambda c: c.at_ns):
        chosen: list[tuple[int, bool, bytes]] = []
        needed = 0
        if call.kind == 'finish':
            found, profiles = call.response.map, 0
            needed = nanoseconds(call.request.until)
            wanted = found.profiles_used + found.profiles_rejected
            while batch < len(batches) and profiles < wanted:
                at, data = batches[batch]
                block = read_batch(data)[1]
                chosen.append((at, True, data))
                profiles, needed = profiles + len(block), max(needed, int(block.stamps.max()))
                batch += 1
        elif call.kind == 'begin':  # what came too late for the map before
            while batch < len(batches) and batches[batch][0] < call.at_ns:
                batch += 1
        while fed < len(frames) and (
            frames[fed][0] < call.at_ns or (fed and stamps[fed - 1] < needed)
        ):
            chosen.append((frames[fed][0], False, frames[fed][1]))
            fed += 1
        chosen.sort(key=lambda item: item[0])
        made.append(Step([(is_profile, data) for _, is_profile, data in chosen], call))
    return made
