"""The whole controller with its inert plant in this process (libwaam_controller_lib), line by line, in ticks of 1 ms:
what the input shaper does to programs, holds and stops. Used by tests of shaped motion.
"""

from __future__ import annotations

import binascii
import re
from collections.abc import Iterable, Sequence

import numpy as np

from waam_bridge.embedded import Controller
from waam_process.plant_port import SAMPLE

STEPS_PER_MM = 320
QUEUE = 40  # lines that wait for their `executed`
TYPES = ('none', 'zv', 'zvd', 'mzv', 'ei', '2hump_ei', '3hump_ei')
FIELDS = (
    'seq', 't_us', 'state', 'flags', 'x_um', 'y_um', 'z_um', 'v_um_s', 'wire_cmd', 'wire', 'current', 'voltage',
    'accepted', 'executed', 'free', 'speed', 'wire_permille', 'lease', 'underruns', 'fault',
)  # fmt: skip
IDLE, RUN, HOLD, ALARM = range(4)


def sealed(text: str) -> bytes:
    return f'{text}*{binascii.crc_hqx(text.encode(), 0xFFFF):05d}\n'.encode()


class Inert(Controller):
    """With a plant of its own that does nothing wrong."""

    new = 'controller_lib_new'


class Machine:
    """Homed and at X 0 Y 0 Z 200. `settings`: of the shaper, as `$C` takes them: shape_x='mzv', shape_x_hz=40.0.
    `true_steps`: that a mm of x, y, z of the machine takes, whatever the controller has."""

    def __init__(
        self, home: bool = True, true_steps: Sequence[float] = (), **settings: float | str
    ) -> None:
        self.core = Inert(1_000_000)
        if len(true_steps):
            self.core.machine_steps(true_steps)
        self._text = ''
        self.next = 1
        self.frame: dict[str, int] = {}
        self.frames: list[dict[str, int]] = []
        self.lines: list[str] = []
        self.samples: list[np.ndarray] = []
        self.ask('$I')
        self.ask('$T 1000')
        for name in sorted(settings, key=lambda n: n in ('shape_x', 'shape_y')):  # types last
            value = settings[name]
            number = TYPES.index(value) if isinstance(value, str) else value
            assert ' ok' in (answer := self.ask(f'$C {name} {number:g}')), answer
        if home:
            self.run('G28')

    def close(self) -> None:
        self.core.close()

    def __del__(self) -> None:
        self.close()

    def _read(self) -> None:
        *whole, self._text = (self._text + self.core.take().decode()).split('\n')
        for line in whole:
            body = line.rpartition('*')[0]
            if body.startswith('T '):
                values = map(int, body[2:].split(','))
                self.frame = dict(zip(FIELDS, values, strict=True))
                self.frames.append(self.frame)
            elif not body.startswith('$H'):
                self.lines.append(re.sub(r' @\d+$', '', body))

    def tick(self, ms: int = 1) -> np.ndarray:
        """Positions (ms, 3) in steps at the end of each tick. The host stays alive and renews the lease."""
        out = np.zeros(ms, SAMPLE)
        for first in range(0, ms, 50):
            self.core.feed(sealed(f'$H t {self.frame.get("t_us", 1)}'))
            part = out[first : first + 50]
            self.core.step(part)
            self._read()
        self.samples.append(out)
        return steps(out)

    def ask(self, line: str) -> str:
        """An immediate line; its answer, without check and stamp."""
        self.core.feed(sealed(line))
        self._read()
        return self.lines[-1]

    def send(self, *gcode: str) -> None:
        """Queued lines, without waiting for their execution."""
        for line in gcode:
            while self.next - self.frame.get('executed', 0) > QUEUE:
                self.tick(5)
            self.core.feed(sealed(f'N{self.next} {line}'))
            self.next += 1
            self._read()
            assert not any(x.startswith(('er ', 'rs ')) for x in self.lines[-3:]), self.lines[-3:]

    def until(self, condition, most: int = 200_000) -> None:
        """Ticks until condition(frame)."""
        for _ in range(most):
            self.tick()
            if condition(self.frame):
                return
        raise AssertionError(f'not within {most} ms: {self.frame}, {self.lines[-3:]}')

    def run(self, *gcode: str) -> None:
        """Until all is executed and the machine is idle."""
        self.send(*gcode)
        self.until(lambda f: f['executed'] == self.next - 1 and f['state'] == IDLE)

    def position(self) -> np.ndarray:
        """Steps (3,) at the end of the last tick."""
        return steps(self.samples[-1][-1:])[0]

    def place(self) -> np.ndarray:
        """Where the machine really is, mm (3,), at the end of the last tick."""
        last = self.samples[-1][-1]
        return 1e3 * np.array([-last['table_x'], -last['table_y'], last['tool_z']])

    def track(self) -> np.ndarray:
        """All positions so far (n, 3), steps."""
        return steps(np.concatenate(self.samples))


def steps(samples: np.ndarray) -> np.ndarray:
    """Machine coordinates (n, 3) in steps."""
    axes = (-samples['table_x'], -samples['table_y'], samples['tool_z'])
    return np.round(np.stack(axes, axis=-1) * 1e3 * STEPS_PER_MM).astype(np.int64)


def target(*mm: float) -> list[int]:
    """Where the controller must stand, steps."""
    return [round(v * STEPS_PER_MM) for v in mm]


def executed_at(frames: Iterable[dict[str, int]], line: int) -> int:
    """Controller time (us) of the first frame that says so."""
    return next(f['t_us'] for f in frames if f['executed'] >= line)
