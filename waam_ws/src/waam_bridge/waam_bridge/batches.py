"""Whether segments are accepted now, and how a checked batch gets into the queue. Pure."""

from __future__ import annotations

from waam_process.names import CONTROLLER_STATES
from waam_process.segment import Point, Segment

from . import frames, program
from .frames import ALARM, HOLD, IDLE
from .machine import Machine
from .program import Modal, Permit, Refusal

QUEUE_SIZE = 20_000  # segments that wait in the bridge; a layer has some thousand


def permit(machine: Machine, job: str, segments: list[Segment]) -> Permit:
    """Raises Refusal. The answer is used with `program.prepare` and `commit`."""
    offset = _check_state(machine, job)
    modal, known = _chain(machine, job)
    new = [s for s in segments if s.index > known]
    if any(s.arc for s in new) and machine.armed_job != job:
        raise Refusal(program.NOT_ARMED, f"armed for '{machine.armed_job}', not for '{job}'")
    if machine.queued + len(new) > QUEUE_SIZE:
        text = f'{machine.queued} segments wait, {len(new)} more do not fit into {QUEUE_SIZE}'
        raise Refusal(program.QUEUE_FULL, text)
    who = machine.link.who
    limits = machine.params.limits(who.limits_mm).reached(who.steps_per_mm)
    here = machine.position if _at_rest(machine) else None
    return Permit(machine.generation, modal, known, here, offset, limits, machine.pace)


def _check_state(machine: Machine, job: str) -> Point:
    """The work zero, m in machine coordinates."""
    if not machine.connected:
        raise Refusal(program.NOT_CONNECTED, machine.message)
    if not job:
        raise Refusal(program.BAD_SEGMENT, 'job_id is empty')
    if machine.broken:
        raise Refusal(program.WRONG_STATE, f'{machine.broken}; stop or arm first')
    if machine.state in (HOLD, ALARM) or machine.dropping:
        text = f'controller is in {CONTROLLER_STATES[machine.state]}: {machine.message}'
        raise Refusal(program.WRONG_STATE, text)
    if not machine.flags & frames.HOMED:
        raise Refusal(program.WRONG_STATE, 'not homed: HOME first')
    if machine.offset is None:
        raise Refusal(program.WRONG_STATE, 'the work zero is not known: SET_ZERO first')
    return machine.offset


def _chain(machine: Machine, job: str) -> tuple[Modal, int]:
    """State of the chain for this job, and the largest index that is known already."""
    modal = machine.modal
    if job == modal.job:
        return modal, machine.done if modal.index is None else modal.index
    if machine.queued:
        text = f"job '{modal.job}' still has {machine.queued} segments"
        raise Refusal(program.WRONG_STATE, text)
    return Modal(job=job), -1


def _at_rest(machine: Machine) -> bool:
    return machine.state == IDLE and not machine.queued and not machine.link.sender.pending


def commit(machine: Machine, granted: Permit, batch: program.Batch) -> None:
    """Puts the lines of a checked batch into the queue. Raises Refusal when the machine was stopped meanwhile."""
    if granted.generation != machine.generation or not machine.connected:
        raise Refusal(program.WRONG_STATE, f'interrupted: {machine.message}')
    if batch.after.job != machine.modal.job:
        machine.done = -1
    machine.modal = batch.after
    put = machine.link.sender.put
    for gcode, mark in batch.lines:
        put(gcode, mark)
