"""What the operator asks of a running job; callbacks write, the job's thread reads."""

from __future__ import annotations

import math
import threading

from waam_process.operating import SPEED_FACTOR, WIRE_FACTOR


class Control:
    """Thread-safe switches. An abort also ends a pause. Requests for the next layer are taken once."""

    def __init__(self, factors: tuple[float, float] = (1.0, 1.0)) -> None:
        """factors: of the override that is in force, speed and wire."""
        self._lock = threading.Lock()
        self._paused = False
        self._abort_reason = ''
        self._requests: set[str] = set()
        self._k_gain: float | None = None
        self._remarks: list[str] = []
        self._factors = factors

    def pause(self) -> None:
        """From the next place on where the job waits."""
        with self._lock:
            self._paused = True

    def resume(self) -> None:
        """Ends a pause."""
        with self._lock:
            self._paused = False

    def abort(self, reason: str) -> None:
        """The first reason counts."""
        with self._lock:
            self._abort_reason = self._abort_reason or reason

    def request(self, what: str) -> None:
        """'rescan' or 'skip_layer', before the next layer."""
        with self._lock:
            self._requests.add(what)

    def take_request(self, what: str) -> bool:
        """Whether 'rescan' or 'skip_layer' was asked for since the last call."""
        with self._lock:
            asked = what in self._requests
            self._requests.discard(what)
            return asked

    def set_k_gain(self, value: float) -> None:
        """In force from the next layer on; NaN = the correction server's own."""
        with self._lock:
            self._k_gain = value

    def k_gain(self, asked: float) -> float:
        """The operator's value, or the one that the job was started with."""
        with self._lock:
            return asked if self._k_gain is None else self._k_gain

    def remark(self, text: str) -> None:
        """Something the operator did elsewhere (an override), to be kept with the job."""
        with self._lock:
            self._remarks.append(text)

    def override(self, speed: float, wire: float) -> None:
        """Factors of the operator's override, which the bridge acts on. NaN leaves one as it is; what the bridge
        refuses changes nothing here either."""
        with self._lock:
            speed = self._factors[0] if math.isnan(speed) else speed
            wire = self._factors[1] if math.isnan(wire) else wire
            (slow, fast), (least, most) = SPEED_FACTOR, WIRE_FACTOR
            if slow <= speed <= fast and least <= wire <= most:
                self._factors = speed, wire

    @property
    def factors(self) -> tuple[float, float]:
        """Of the operator's override in force: speed, wire."""
        with self._lock:
            return self._factors

    @property
    def metal_factor(self) -> float:
        """By which the operator's override changes the metal per length of path; 1 = not at all."""
        speed, wire = self.factors
        return wire / speed

    def take_remarks(self) -> list[str]:
        """Remarks since the last call."""
        with self._lock:
            taken, self._remarks = self._remarks, []
            return taken

    @property
    def paused(self) -> bool:
        """False also once the job is aborted."""
        with self._lock:
            return self._paused and not self._abort_reason

    @property
    def abort_reason(self) -> str:
        """'' while the job is not to be aborted."""
        with self._lock:
            return self._abort_reason
