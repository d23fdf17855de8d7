"""Whether segments may come now, and how a batch that passed gets into the queue. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from waam_process.segment import Segment

from . import frames, program
from .frames import ALARM, HOLD, IDLE, STATE_NAMES
from .program import Modal, Permit, Refusal

if TYPE_CHECKING:
    from .core import Bridge


def permit(bridge: Bridge, job: str, segments: list[Segment]) -> Permit:
    """Raises Refusal. The answer is used with `program.prepare` and `commit`."""
    _check_state(bridge, job)
    modal, known = _chain(bridge, job)
    new = [s for s in segments if s.index > known]
    if any(s.arc for s in new) and bridge.armed_job != job:
        raise Refusal(program.NOT_ARMED, f"armed for '{bridge.armed_job}', not for '{job}'")
    most = bridge.params.queue_size
    if bridge.queued + len(new) > most:
        text = f'{bridge.queued} segments wait, {len(new)} more do not fit into {most}'
        raise Refusal(program.QUEUE_FULL, text)
    limits = bridge.params.limits(bridge.link.identity.limits_mm)
    here = bridge.position if _at_rest(bridge) else None
    return Permit(bridge.generation, modal, known, here, bridge.offset, limits)


def _check_state(bridge: Bridge, job: str) -> None:
    if not bridge.connected:
        raise Refusal(program.NOT_CONNECTED, bridge.message)
    if not job:
        raise Refusal(program.BAD_SEGMENT, 'job_id is empty')
    if bridge.broken:
        raise Refusal(program.WRONG_STATE, f'{bridge.broken}; stop or arm first')
    if bridge.state in (HOLD, ALARM) or bridge.dropping:
        text = f'controller is in {STATE_NAMES[bridge.state]}: {bridge.message}'
        raise Refusal(program.WRONG_STATE, text)
    if not bridge.flags & frames.HOMED:
        raise Refusal(program.WRONG_STATE, 'not homed: HOME first')
    if bridge.offset is None:
        raise Refusal(program.WRONG_STATE, 'the work zero is not known: SET_ZERO first')


def _chain(bridge: Bridge, job: str) -> tuple[Modal, int]:
    """State of the chain for this job, and the largest index that is known already."""
    modal = bridge.modal
    if job == modal.job:
        return modal, bridge.done if modal.index is None else modal.index
    if bridge.queued:
        text = f"job '{modal.job}' still has {bridge.queued} segments"
        raise Refusal(program.WRONG_STATE, text)
    return Modal(job=job), -1


def _at_rest(bridge: Bridge) -> bool:
    return bridge.state == IDLE and not bridge.queued and not bridge.link.sender.pending


def commit(bridge: Bridge, granted: Permit, batch: program.Batch) -> None:
    """Puts the lines of a checked batch into the queue. Raises Refusal when the machine was stopped meanwhile."""
    if granted.generation != bridge.generation or not bridge.connected:
        raise Refusal(program.WRONG_STATE, f'interrupted: {bridge.message}')
    if batch.after.job != bridge.modal.job:
        bridge.done = -1
    bridge.modal = batch.after
    put = bridge.link.sender.put
    for gcode, mark in batch.lines:
        put(gcode, mark)
