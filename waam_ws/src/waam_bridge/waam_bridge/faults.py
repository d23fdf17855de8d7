"""What goes wrong: changes of state, refused lines, lines that the controller denies. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from . import frames, requests
from .frames import ALARM, HOLD
from .outbox import FAULT, LEASE_EXPIRED, of_fault

if TYPE_CHECKING:
    from .core import Bridge


def state_changed(bridge: Bridge, state: int, code: int, text: str) -> None:
    """The controller told its state and why; an empty text is one that was not told (telemetry)."""
    new = (state, code) != (bridge.state, bridge.fault)
    if not new and not (text and text != bridge.fault_text):
        return
    bridge.state, bridge.fault = state, code
    bridge.fault_text = (text or frames.CODES.get(code, '')) if code else ''
    bridge.outbox.changed = True
    if new and code == LEASE_EXPIRED and bridge.link.telemetry:
        bridge.arming.expired(bridge.link.telemetry.t_us)
    if new and state in (HOLD, ALARM) and code:
        notice = of_fault(state, code, bridge.fault_text, bridge.silent)
        bridge.outbox.notices.append(notice)
        bridge.say(bridge.broken or notice.text)
    if new and state == ALARM:
        bridge.link.sender.blocked = True
        bridge.dropping = f'ALARM E{code} {bridge.fault_text}'.rstrip()


def line_refused(bridge: Bridge, refused: frames.LineRefused) -> None:
    """What the controller has is still executed, the rest is dropped."""
    sender = bridge.link.sender
    if sender.blocked:
        return
    text = f'E{refused.code} {refused.text or frames.CODES.get(refused.code, "")}'.rstrip()
    if refused.seq == bridge.pending.home_line:
        due = bridge.outbox.replies
        bridge.pending.end_home(requests.REFUSED, f'controller: {text}', due)
        bridge.forget()
        return
    where = f'line {refused.seq} refused: {text} at column {refused.column}'
    bridge.broken = where
    lost = sender.drop(keep=refused.seq - 1)
    bridge.link.resync()
    bridge.moved()
    bridge.say(f'{where}; {lost} segments dropped')
    bridge.notice(FAULT, 'link', where, 'abort')


def lines_denied(bridge: Bridge, why: str) -> None:
    """The two ends disagree about what was sent: stand still, an operator decides."""
    bridge.broken = why
    bridge.link.sender.blocked = True
    bridge.link.out.append(frames.HOLD_NOW)
    bridge.say(why)
    bridge.notice(FAULT, 'link', why, 'hold')
