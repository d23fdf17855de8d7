"""The cell that is commissioned, as its graph shows it: telemetry, state, temperature, commands. Nothing of a simulated
cell is used."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import Vector3
from sensor_msgs.msg import Temperature
from std_srvs.srv import SetBool

from waam_msgs.msg import Telemetry
from waam_msgs.srv import Command
from waam_node.qos import BEAT
from waam_process.segment import Kind, Segment

from .client import ANSWER_S, MATCHING_S, SERVER_S, ClientError
from .shaking import HOMING_S, NAME, SILENT_S, Shaking

FRAMES = 100  # of telemetry that a reading takes
READINGS = 20  # of the temperature
READ_S = 30.0  # at most, for them
STATE_S = 10.0  # until the state shows what was done
JOG_SPEED, TRAVEL_SPEED = 0.005, 0.04  # m/s
STRIKE_S = 120.0
END_MM = 10.0
NOTHING_MM = 0.01
TRIES = 2  # of a request that does no harm twice
ONCE = (Command.Request.JOG, Command.Request.JOG_WIRE)
STRIKE_WIRE, STRIKE_VOLTAGE = 0.05, 18.0  # SI, in the middle of what a bridge takes


class CommissionedCell(Shaking):
    """Use as a context manager. Lengths mm, machine axes."""

    def __init__(
        self, domain: int, board: bool = False, trouble: Callable[[], str] = lambda: ''
    ) -> None:
        """board: the controller is one, and not simulated; trouble: why the graph can finish no job any more."""
        super().__init__(domain)
        self.domain, self.board, self.trouble = domain, board, trouble
        self.frames: list[Telemetry] = []
        self.celsius: list[float] = []
        self._clients: dict[str, Any] = {}
        self.node.create_subscription(Temperature, 'temperature', self._on_temperature, BEAT)

    def _on_temperature(self, message: Temperature) -> None:
        self.celsius.append(message.temperature)

    def __enter__(self) -> CommissionedCell:
        return self

    def _on_telemetry(self, message: Telemetry) -> None:
        super()._on_telemetry(message)
        self.frames.append(message)

    def offers(self, kind: Any, name: str, seconds: float) -> bool:
        """Whether there is such a service, for which it is looked so long."""
        looking = self.node.create_client(kind, name)
        try:
            return self.until(looking.service_is_ready, seconds)
        finally:
            self.node.destroy_client(looking)

    def deaf(self) -> str:
        """Why no accelerometer is listened to, '' = there is one."""
        if not self.offers(SetBool, 'accelerometer/enable', STATE_S):
            return 'the controller has no accelerometer'
        on = self.ask(SetBool, 'accelerometer/enable', SetBool.Request(data=True))
        self.ask(SetBool, 'accelerometer/enable', SetBool.Request(data=False))
        return '' if on.success else f'the accelerometer: {on.message}'

    def ask(self, kind: Any, name: str, request: Any, repeat: bool = True) -> Any:
        """The answer of a service, whose client is kept. repeat: one that does no harm twice is sent again, as the
        answer to a new client may be lost. ClientError when there is none."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
            if not self.until(self._clients[name].service_is_ready, SERVER_S):
                raise ClientError(f'service {name} is not there; is the graph up? (waam up)')
            self.until(lambda: False, MATCHING_S)
        asked = []
        for _ in range(TRIES if repeat else 1):
            asked.append(self._clients[name].call_async(request))
            if self.until(lambda: any(f.done() for f in asked), ANSWER_S):
                return next(f.result() for f in asked if f.done())
        raise ClientError(f'service {name} did not answer (waam status)')

    def order(self, code: int, **fields: Any) -> tuple[int, str]:
        """A command; error code (0 = done) and what was said."""
        request = Command.Request(code=code, **fields)
        answer = self.ask(Command, 'bridge/command', request, code not in ONCE)
        return answer.error_code, answer.message

    def command(self, code: int, text: str = '', value: float = 0.0) -> str:
        error, said = self.order(code, text=text, value=value)
        if error:
            raise ClientError(f'{said} (error {error})')
        return said

    def known(self) -> Any:
        """The state of the machine. ClientError when no controller answers."""
        self.until(lambda: self.machine is not None and self.machine.connected, STATE_S)
        if self.machine is None or not self.machine.connected:
            why = self.machine.message if self.machine else 'no state comes from the bridge'
            raise ClientError(f'the controller does not answer: {why} (waam ports, waam status)')
        return self.machine

    def fault(self) -> int:
        """The code of the ALARM that the machine is in; 0 = it is in none."""
        m = self.known()
        return m.fault if m.state == Telemetry.STATE_ALARM else 0

    def alarmed(self, code: int) -> bool:
        """Whether the machine is in ALARM with this code."""
        m = self.machine
        return m is not None and m.state == Telemetry.STATE_ALARM and m.fault == code

    def reset(self) -> str:
        """Leaves ALARM, where the machine is in it; what refuses that, '' = nothing."""
        if not self.fault():
            return ''
        error, said = self.order(Command.Request.RESET)
        if error:
            return said
        return '' if self.until(self._reset, STATE_S) else 'the machine stays in ALARM'

    def fresh(self, count: int = FRAMES) -> list[Telemetry]:
        """The next frames of telemetry. ClientError when they do not come."""
        self.until(lambda: False, 0.2)  # what has waited meanwhile
        self.frames.clear()
        if not self.until(lambda: len(self.frames) >= count, READ_S):
            raise ClientError(f'{len(self.frames)} of {count} frames of telemetry in {READ_S:g} s')
        return list(self.frames)

    def warmth(self) -> float:
        """Mean of the next readings of the temperature, degrees Celsius; NaN when none comes, or one is unknown."""
        self.until(lambda: False, 0.2)
        self.celsius.clear()
        self.until(lambda: len(self.celsius) >= READINGS, READ_S)
        return float(np.mean(self.celsius)) if self.celsius else float('nan')

    def travel(self) -> tuple[float, float, float]:
        """mm between the soft limits of X, Y and Z."""
        low, high = self.known().limit_min, self.known().limit_max
        return 1e3 * (high.x - low.x), 1e3 * (high.y - low.y), 1e3 * (high.z - low.z)

    def at_top(self, axis: str) -> bool:
        """Whether the axis is homed and stands at its upper end."""
        m = self.known()
        at = self._at(axis) + 1e3 * getattr(m.work_offset, axis)
        return bool(m.homed) and at > 1e3 * getattr(m.limit_max, axis) - END_MM

    def jog(self, axis: str, mm: float, speed: float = JOG_SPEED) -> None:
        """Moves by so much and waits until the machine rests. ClientError when it does not get there."""
        if abs(mm) < NOTHING_MM:
            return
        before = self._at(axis)
        vector = Vector3(**{axis: 1e-3 * mm})
        error, said = self.order(Command.Request.JOG, vector=vector, value=speed)
        if error:
            raise ClientError(f'jog of {axis} by {mm:g} mm: {said}')
        if not self.until(
            lambda: self._stands(axis, before + mm), SILENT_S + abs(mm) * 1e-3 / speed
        ):
            m = self.known()
            raise ClientError(
                f'jog of {axis} by {mm:g} mm did not end: {m.fault_text or m.message}'
            )

    def _at(self, axis: str) -> float:
        """mm, work frame, by the newest telemetry."""
        return 1e3 * getattr(self.fresh(1)[-1].position, axis)

    def _stands(self, axis: str, at: float) -> bool:
        t = self.telemetry
        if t is None or t.state != Telemetry.STATE_IDLE:
            return False
        return abs(1e3 * getattr(t.position, axis) - at) < 0.05

    def home(self) -> None:
        """ClientError when it is refused, or the machine does not come to rest homed."""
        self.command(Command.Request.HOME)
        self.fresh(5)
        self.until(lambda: not self._rests(), 1.0)  # the state of before
        ended = self.until(lambda: self._rests() or self.in_alarm(), HOMING_S)
        if not ended or not self._rests():
            m = self.known()
            raise ClientError(f'homing did not end: {m.fault_text or m.message}')

    def in_alarm(self) -> bool:
        """Whether the machine is in ALARM."""
        return self.machine is not None and self.machine.state == Telemetry.STATE_ALARM

    def go(self, axis: str, machine_mm: float) -> None:
        """To a place in machine coordinates."""
        zero = 1e3 * getattr(self.known().work_offset, axis)
        self.jog(axis, machine_mm - zero - self._at(axis), TRAVEL_SPEED)

    def feed_wire(self, mm: float) -> float:
        """Feeds wire; how much its wheel has counted, mm."""
        self.fresh(1)
        self.frames.clear()
        error, said = self.order(Command.Request.JOG_WIRE, value=1e-3 * mm)
        if error:
            raise ClientError(f'wire: {said}')
        self.until(lambda: any(f.wire_feed_commanded for f in self.frames), STATE_S)
        still = 50  # frames without a command and without motion
        ended = self.until(lambda: _stopped(self.frames, still), SILENT_S + abs(mm) * 0.1)
        if not ended:
            raise ClientError('the wire does not stop (waam stop)')
        seconds = np.array([f.controller_us for f in self.frames]) * 1e-6
        speed = np.array([f.wire_feed_speed for f in self.frames])
        return float(1e3 * np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(seconds)))

    def strike(self) -> tuple[int, bool]:
        """An arc start where the machine stands, with the source off: code of the fault that ended it (0 = none did),
        and whether an arc was there. The machine is stopped and disarmed afterwards."""
        here, job = self.here, f'{NAME}_{self.node.get_clock().now().nanoseconds}'
        segment = Segment(
            0,
            Kind.DWELL,
            here,
            here,
            0.0,
            arc=True,
            dwell=0.5,
            wire_feed_speed=STRIKE_WIRE,
            voltage=STRIKE_VOLTAGE,
        )
        self.frames.clear()
        self.command(Command.Request.ARM, job)
        try:
            self.enqueue([segment], job)
            self.until(lambda: self._ended() or self._burns(), STRIKE_S)
            return (self.known().fault if self._ended() else 0), self._burns()
        finally:
            self.order(Command.Request.STOP)
            self.order(Command.Request.DISARM)

    def _ended(self) -> bool:
        m = self.machine
        return m is not None and m.state in (Telemetry.STATE_HOLD, Telemetry.STATE_ALARM)

    def _burns(self) -> bool:
        return any(f.arc_established for f in self.frames)


def _stopped(frames: list[Telemetry], still: int) -> bool:
    last = frames[-still:]
    begun = any(f.wire_feed_commanded for f in frames)
    return (
        begun
        and len(last) == still
        and not any(f.wire_feed_commanded or f.wire_feed_speed > 1e-4 for f in last)
    )
