"""Controller, simulated cell and the host's end of the link in lock-step: as the graph runs them, without waiting.

Every exchange is 10 ms of controller time: the host's bytes go in, the controller runs, the cell lives through what the
outputs did, and its readings are what the controller sees in the next 10 ms.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from waam_bridge import commands, requests
from waam_bridge.core import Bridge
from waam_bridge.embedded import Controller
from waam_bridge.frames import Telemetry
from waam_bridge.outbox import Outbox
from waam_bridge.params import BridgeParams, CommonParams
from waam_process.plant_port import SAMPLE
from waam_robot_bridge.controller import RobotController
from waam_sim.plant import Plant, Profiles

# where every simulated clock starts: figures must not depend on today
EPOCH_US = 1_750_000_000_000_000
EXCHANGE_MS = 10  # of host/host.h (STEP_US)
STEPS_PER_MM = 320.0  # of a controller that was told nothing
ANSWER_LIMIT = 3.0  # s of controller time that an answer may take
CONNECT_LIMIT = 5.0  # s


class Machine:
    """`advance` lets time pass. Results go to the listeners: on_frame(Telemetry), on_outbox(Outbox),
    on_temperature(time_us, degC), on_profiles(Profiles), on_exchange(samples (n,) of SAMPLE, Plant)."""

    def __init__(self, params: CommonParams, plant: Plant, turn_steps: float = 0.0) -> None:
        """turn_steps: of a chuck in place of the X axis, 0 = there is none."""
        self.bridge, self.plant, self._turn_steps = Bridge(params), plant, turn_steps
        self.controller = self._make_controller()
        self.time_us = EPOCH_US
        self.on_frame: Callable[[Telemetry], None] = lambda frame: None
        self.on_outbox: Callable[[Outbox], None] = lambda box: None
        self.on_temperature: Callable[[int, float], None] = lambda time_us, celsius: None
        self.on_profiles: Callable[[Profiles], None] = lambda profiles: None
        self.on_exchange: Callable[[np.ndarray, Plant], None] = lambda samples, plant: None
        self._samples = np.zeros(EXCHANGE_MS, SAMPLE)
        self._step_us = 1000 * EXCHANGE_MS
        self._pyro_us = round(1e6 / plant.params.pyrometer.rate)
        self._rest = b''  # of a line that is not complete

    def _make_controller(self) -> Controller | RobotController:
        """The gantry takes the steps per mm that the parameters say, else the controller's own; a chuck a thousandth of
        those of a turn, for 1 m is one (`Plant.placed_samples`)."""
        p = self.bridge.params
        assert isinstance(p, BridgeParams)  # of a robot: RobotMachine
        steps = (p.steps_per_mm_x, p.steps_per_mm_y, p.steps_per_mm_z)
        controller = Controller(EPOCH_US)
        true = [STEPS_PER_MM if math.isnan(v) else v for v in steps]
        controller.machine_steps([self._turn_steps / 1e3 or true[0], *true[1:]])
        return controller

    def close(self) -> None:
        """Frees the controller."""
        self.controller.close()

    @property
    def now(self) -> float:
        """Controller time, s."""
        return self.time_us * 1e-6

    def connect(self) -> None:
        """Identifies the controller. RuntimeError when it does not answer, which is a fault of this software."""
        self.bridge.opened(self.now)
        self.until(lambda: self.bridge.connected, CONNECT_LIMIT)
        if not self.bridge.connected:
            raise RuntimeError(f'no controller: {self.bridge.link.failed or self.bridge.message}')
        settling = (self.bridge.standoff, self.bridge.gantry)
        self.until(lambda: all(s.settled for s in settling), CONNECT_LIMIT)

    def until(self, done: Callable[[], bool], limit: float) -> bool:
        """Lets time pass until `done`, at most `limit` s. Returns whether it became true."""
        end = self.now + limit
        while not done() and self.now < end:
            self.step()
        return done()

    def advance(self, seconds: float) -> None:
        """Lets at least `seconds` pass."""
        end = self.time_us + round(seconds * 1e6)
        while self.time_us < end:
            self.step()

    def command(self, command: commands.Command) -> tuple[int, str]:
        """Code and text of the answer (waam_msgs/srv/Command)."""
        answers: list[tuple[int, str]] = []
        commands.run(
            self.bridge, command, lambda code, text: answers.append((code, text)), self.now
        )
        self._publish()
        self.until(lambda: bool(answers), ANSWER_LIMIT)
        return answers[0] if answers else (requests.TIMEOUT, 'no answer')

    def step(self) -> None:
        """One exchange."""
        now = self.now
        data = self.bridge.poll(now)
        if data:
            self.controller.feed(data)
            self.bridge.link.wrote(now)
        self.controller.step(self._samples)
        self._samples[:] = self.plant.placed_samples(self._samples)
        self.time_us += self._step_us
        self._live()
        self.on_exchange(self._samples, self.plant)
        self._sense()
        self._listen()
        self._publish()

    def _live(self) -> None:
        """The cell lives through what the outputs did; its readings are the controller's next inputs."""
        self.controller.answer(self.plant.step(self._samples, self.time_us))

    def _profiles(self) -> Profiles | None:
        return self.plant.profiles(self._samples)

    def _sense(self) -> None:
        """Pyrometer and scanner, when they are due."""
        if self.time_us % self._pyro_us < self._step_us:
            self.on_temperature(self.time_us, self.plant.temperature(self._pyro_us * 1e-6))
        if self.plant.scanning:
            profiles = self._profiles()
            if profiles is not None:
                self.on_profiles(profiles)

    def _listen(self) -> None:
        data = self._rest + self.controller.take()
        if not data:
            return
        now = self.now
        *lines, self._rest = data.split(b'\n')
        for line in lines:
            frame = self.bridge.line(line, now)
            if frame is not None:
                self.on_frame(frame)

    def _publish(self) -> None:
        if not self.bridge.outbox:
            return
        box = self.bridge.take_outbox()
        self.on_outbox(box)
        for reply in box.replies:
            reply()
