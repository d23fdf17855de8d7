"""What goes wrong: changes of state, refused lines, lines that the controller denies. Pure."""

from __future__ import annotations

from . import frames, requests
from .frames import ALARM, HOLD
from .machine import Machine
from .outbox import FAULT, HOLD_BY_HOST, LEASE_EXPIRED, WARNING, Notice, of_fault


def state_changed(machine: Machine, state: int, code: int, text: str) -> None:
    """The controller reported its state and the reason; the text is empty when only telemetry showed it."""
    if code == frames.STANDOFF:
        machine.outbox.notices.append(Notice(WARNING, 'height', f'E{code} {text}', 'none'))
        return
    if machine.state == HOLD and state != HOLD:
        machine.held_because = ''
    if code == HOLD_BY_HOST and machine.held_because:
        text = machine.held_because
    new = (state, code) != (machine.state, machine.fault)
    if not new and not (text and text != machine.fault_text):
        return
    machine.state, machine.fault = state, code
    machine.fault_text = (text or frames.CODES.get(code, '')) if code else ''
    machine.outbox.changed = True
    if new and code == LEASE_EXPIRED and machine.link.telemetry:
        machine.arming.expired(machine.link.telemetry.t_us)
    if new and state in (HOLD, ALARM) and code:
        notice = of_fault(state, code, machine.fault_text, machine.silent)
        machine.outbox.notices.append(notice)
        machine.say(machine.broken or notice.text)
    if new and state == ALARM:
        machine.link.sender.blocked = True
        machine.dropping = f'ALARM E{code} {machine.fault_text}'.rstrip()


def held(machine: Machine, why: str) -> None:
    """This end has held the controller, for a reason that the controller does not know."""
    machine.held_because = why
    machine.notice(FAULT, 'link', why, 'hold')


def line_refused(machine: Machine, refused: frames.LineRefused) -> None:
    """What the controller has is still executed, the rest is dropped."""
    sender = machine.link.sender
    if sender.blocked:
        return
    text = f'E{refused.code} {refused.text or frames.CODES.get(refused.code, "")}'.rstrip()
    if refused.seq == machine.pending.home_line:
        due = machine.outbox.replies
        machine.pending.end_home(requests.REFUSED, f'controller: {text}', due)
        machine.forget()
        return
    where = f'line {refused.seq} refused: {text} at column {refused.column}'
    machine.broken = where
    lost = sender.drop(keep=refused.seq - 1)
    machine.link.resync()
    machine.reopen()
    machine.say(f'{where}; {lost} segments dropped')
    machine.notice(FAULT, 'link', where, 'abort')


def lines_denied(machine: Machine, why: str) -> None:
    """The two ends disagree about what was sent: hold, an operator decides."""
    machine.broken = why
    machine.link.sender.blocked = True
    machine.link.out.append(frames.HOLD_NOW)
    machine.say(why)
    machine.notice(FAULT, 'link', why, 'hold')
