"""Watches the machine while the job waits: link, faults, silent nodes, pause, abort. One place for every reaction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from waam_process.names import CLASS_OF_FAULT

from ..model.cell import Cell, Machine
from ..model.goal import Code, JobError
from .again import Again
from .control import Control

LEASE_EXPIRED = 202  # controller code, docs/link_protocol.md
HOST_HOLD, HELD_BY_HOST = 200, 'hold by host'
# somebody must see to the place or to the wire; the controller keeps its queue and strikes again
NO_ARC, WIRE, WIRE_STUCK = 205, 206, 211
RESUMED_S, RESUMED_LOOK_S = 3.0, 0.1  # wall time that telemetry may need to show it


@dataclass(frozen=True)
class Limits:
    """Wall-clock patience: link s without telemetry, node s of silence; retries of a hold that the lease caused."""

    link_timeout: float = 5.0
    node_timeout: float = 4.0
    lease_retries: int = 3
    poll: float = 0.02


class Watch:
    """Call `tick` in every waiting loop; it waits a moment of wall time and raises JobError when the job cannot go on.

    note(severity, class_name, text, reaction) records anomalies; paused(bool, why, class_name) is called when a pause
    begins or ends; why: what has held the machine, '' = the operator.
    """

    def __init__(
        self,
        cell: Cell,
        control: Control,
        limits: Limits,
        note: Callable[[str, str, str, str], None],
        paused: Callable[[bool, str, str], None],
    ) -> None:
        self.cell, self.control, self.limits = cell, control, limits
        self.note, self.paused = note, paused
        self._silent_for = 0.0
        self._lease_holds = 0
        self.again: Again | None = None  # the path that is being laid
        self.held = 0.0  # s of ROS time in pauses so far: no deadline counts them

    def tick(self) -> Machine:
        """One look at the machine. Returns it when all is well."""
        self._check_abort()
        machine = self.cell.machine()
        self._check_link(machine)
        self._check_nodes(machine)
        self._check_alarm(machine)
        if machine.state == 'HOLD':
            self._on_hold(machine)
        elif self.control.paused:
            self._pause()
        self.cell.wait(self.limits.poll)
        return machine

    def _check_abort(self) -> None:
        if self.control.abort_reason:
            raise JobError(Code.ABORTED, self.control.abort_reason)

    def _check_link(self, machine: Machine) -> None:
        if machine.age > self.limits.link_timeout:
            raise JobError(
                Code.LINK_LOST,
                f'no telemetry for {machine.age:.1f} s: bridge or link is gone (the controller ends the arc itself)',
            )
        if not machine.connected:
            why = f': {machine.message}' if machine.message else ''
            raise JobError(Code.LINK_LOST, f'the controller is not connected{why}')

    def _check_alarm(self, machine: Machine) -> None:
        if machine.state == 'ALARM':
            text = f'controller in ALARM: {machine.fault_text or machine.fault}'
            if machine.silent_nodes:
                text += f'; {", ".join(machine.silent_nodes)} fell silent before'
            kind = CLASS_OF_FAULT.get(machine.fault, 'link')
            self.note('ALARM', kind, text, 'arc and motion ended by the controller, job ended')
            raise JobError(Code.DEPOSITION_FAILED, text)

    def _check_nodes(self, machine: Machine) -> None:
        self._silent_for = self._silent_for + self.limits.poll if machine.silent_nodes else 0.0
        if self._silent_for > self.limits.node_timeout:
            why = f'{", ".join(machine.silent_nodes)} fell silent'
            if machine.message.startswith('two nodes called'):
                why = machine.message
            self.note('ALARM', 'node', why, 'arc lease withheld, job ended')
            raise JobError(Code.NODE_LOST, f'{why}; the arc lease was withheld')

    def _on_hold(self, machine: Machine) -> None:
        """A hold by the operator, for want of wire or where no arc strikes waits for resume; a hold by the lease is
        resumed when all nodes are back; any other one ends the job."""
        if machine.fault == LEASE_EXPIRED:
            if machine.silent_nodes:
                return  # _check_nodes decides
            self._lease_holds += 1
            text = f'arc lease ran out: {machine.fault_text or "heartbeat late"}'
            if self._lease_holds > self.limits.lease_retries:
                raise JobError(
                    Code.DEPOSITION_FAILED, f'{text}, {self._lease_holds} times in this job'
                )
            self.note('WARNING', 'link', text, 'hold, all nodes answer again, resumed')
            self._go_on()
            return
        if machine.fault in (0, HOST_HOLD):
            by_operator = machine.fault_text in ('', HELD_BY_HOST)
            self._pause('' if by_operator else machine.fault_text)
            return
        kind = CLASS_OF_FAULT.get(machine.fault, 'link')
        text = machine.fault_text or f'hold {machine.fault}'
        if machine.fault in (NO_ARC, WIRE, WIRE_STUCK):
            self._pause(text, kind)
            return
        self.note('FAULT', kind, text, 'hold, job ended')
        raise JobError(Code.DEPOSITION_FAILED, f'controller holds: {text}')

    def hold(self, why: str, kind: str) -> None:
        """Pauses the job for the reason `why` (class `kind` of anomalies) until resume; JobError on abort."""
        self._pause(why, kind)

    def _pause(self, why: str = '', kind: str = 'link') -> None:
        """Holds the machine until resume or abort."""
        self.control.pause()
        if self.cell.machine().state == 'RUN':
            self.cell.command('HOLD')
        self.paused(True, why, kind)
        began = self.cell.now()
        while self.control.paused:
            machine = self.cell.machine()
            self._check_link(machine)
            self._check_alarm(machine)
            self.cell.wait(0.05)
        self._check_abort()
        self.held += self.cell.now() - began
        self.paused(False, '', '')
        machine = self.cell.machine()
        if machine.state != 'HOLD':
            return
        again = self.again if machine.fault in (NO_ARC, WIRE) else None
        if again is not None and again.gap(machine):
            again.lay(machine, lambda: self._go_on('STOP'))
        else:
            self._go_on()

    def _go_on(self, command: str = 'RESUME') -> None:
        """Waits until the machine reports another state; an older one would be mistaken for a new hold."""
        self.cell.command(command)
        for _ in range(round(RESUMED_S / RESUMED_LOOK_S)):
            self.cell.wait(RESUMED_LOOK_S)
            if self.cell.machine().state != 'HOLD':
                return
