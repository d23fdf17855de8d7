"""A plan on the controller core alone: where it has the torch in every ms of every bead. No metal, no heat."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from waam_bridge import commands, program
from waam_bridge.embedded import Controller
from waam_bridge.frames import ALARM, HOLD, HOMED, IDLE
from waam_plan.gcode.program import with_base_feed
from waam_plan.plan import Plan, PlannedLayer, renumber
from waam_process.segment import Kind, Segment
from waam_robot.station import Reach, Station
from waam_robot_bridge.foresee import Bead
from waam_robot_bridge.goals import tips_of
from waam_robot_bridge.pace import Pacer
from waam_robot_bridge.params import RobotParams
from waam_sim import part
from waam_sim.plant import INPUT_GAS_OK, OUTPUT_ARC, Plant, Reading

from ..machine import EPOCH_US, Machine

JOB = 'dry run'
HOME_LIMIT = 60.0  # s
PATIENCE = 3.0  # times the planned duration, and HOME_LIMIT
CURRENT, VOLTAGE = 150.0, 22.0  # A, V of an arc that is lit at once
RIPPLE = 0.2  # A, V: a value that never changes is a fault of its sensor


class DryRunError(ValueError):
    """The machine refuses the plan; the text says which segment and why."""


class DryMachine(Machine):
    """The arc burns as soon as it is wanted; with a station its drives pace the segments. Kept of every exchange:
    `tips` (10, 3) m and `arc` (10,) bool."""

    def __init__(self, params: RobotParams, station: Reach | None = None) -> None:
        super().__init__(params, Plant(part.plate(0.02, 0.02, 0.01, 2e-3, 2e-3)))
        assert isinstance(self.controller, Controller)
        self.controller.widen(params.work_low, params.work_high)
        if station is not None:
            self.bridge.pace = Pacer(station, params)
        self.tips: list[np.ndarray] = []
        self.arc: list[np.ndarray] = []
        self._ripple = RIPPLE

    def _make_controller(self) -> Controller:
        return Controller(EPOCH_US)  # the core that a robot's bridge holds takes no steps

    def _live(self) -> None:
        arc = (self._samples['outputs'] & OUTPUT_ARC) > 0
        self.tips.append(tips_of(self._samples))
        self.arc.append(arc)
        wire = float(self._samples['wire_cmd'][-1])
        self._ripple = -self._ripple
        current, voltage = (
            (CURRENT + self._ripple, VOLTAGE + self._ripple) if arc[-1] else (0.0, 0.0)
        )
        self.controller.answer(Reading(INPUT_GAS_OK, current, voltage, wire))

    def ask(self, command: commands.Command) -> None:
        """DryRunError when the controller refuses."""
        code, text = self.command(command)
        if code:
            raise DryRunError(f'command {command.code}: {text}')

    def begin(self, zero: tuple[float, float, float]) -> None:
        """Homes, sets the work zero (m, machine coordinates) and arms."""
        self.connect()
        for name in (commands.RESET, commands.HOME):
            self.ask(commands.Command(name))
        self.until(
            lambda: bool(self.bridge.flags & HOMED) and self.bridge.state == IDLE, HOME_LIMIT
        )
        self.ask(commands.Command(commands.SET_ZERO, vector=zero))
        self.ask(commands.Command(commands.ARM, text=JOB))
        self.advance(0.5)

    def run(self, segments: list[Segment]) -> None:
        """Executes segments that begin where the torch is. DryRunError where one is refused."""
        try:
            permit = self.bridge.permit(JOB, segments)
            self.bridge.commit(permit, program.prepare(permit, segments, True))
        except program.Refusal as e:
            raise DryRunError(str(e)) from None
        self.advance(0.1)
        limit = PATIENCE * sum(s.duration for s in segments) + HOME_LIMIT
        self.until(lambda: self._rests() or self.bridge.state in (HOLD, ALARM), limit)
        if not self._rests() or self.bridge.broken:
            raise DryRunError(f'the controller did not finish: {self.bridge.message}')

    def _rests(self) -> bool:
        return self.bridge.state == IDLE and not self.bridge.queued


def work_zero(plan: Plan, station: Reach | None = None) -> tuple[float, float, float]:
    """m, machine coordinates: the plan's reach is that of the machine; of a tilted part on the faceplate of a station,
    where it stands at its tilt."""
    zero = tuple(-v for v in plan.settings.machine_min)
    if isinstance(station, Station) and plan.settings.tilt_deg and not plan.settings.clamp:
        # the lower corner, of which the plan's offset is counted, is carried with the faceplate
        zero = tuple(map(float, station.carried(np.array([zero]))[0] - plan.offset))
    x, y, z = zero
    return (x, y, z)


@dataclass(frozen=True)
class Laid:
    """A layer as the core lays it: beads, each from arc on to arc off; tips: (n, 3) m, machine coordinates, where it
    has the torch in every ms, ways to the beads included."""

    number: int
    beads: tuple[Bead, ...]
    tips: np.ndarray


def layers(
    plan: Plan,
    params: RobotParams,
    told: Callable[[int], None] = lambda layer: None,
    station: Reach | None = None,
) -> Iterator[Laid]:
    """The plan, layer by layer; `told` after each. DryRunError where the machine refuses a segment."""
    machine, zero = DryMachine(params, station), work_zero(plan, station)
    try:
        machine.begin(zero)
        number = 0
        for layer in plan.layers:
            here = machine.bridge.position
            assert here is not None  # after homing
            fed = clipped(with_base_feed(layer.segments, plan.settings), params)
            segments = renumber(fed, number, here, plan.settings, plan.safe_z)
            number += len(segments)
            machine.tips.clear()
            machine.arc.clear()
            machine.run(segments)
            yield Laid(
                layer.number, tuple(_laid(layer, machine, zero)), np.concatenate(machine.tips)
            )
            told(layer.number)
    finally:
        machine.close()


def clipped(segments: list[Segment], params: RobotParams) -> list[Segment]:
    """Wire feeds within the limits of the machine, as a job sets them."""
    low, high = params.wire_feed_min, params.wire_feed_max
    return [
        s.at(wire_feed_speed=min(max(s.wire_feed_speed, low), high)) if s.arc else s
        for s in segments
    ]


def _laid(
    layer: PlannedLayer, machine: DryMachine, zero: tuple[float, float, float]
) -> Iterator[Bead]:
    tips, arc = np.concatenate(machine.tips), np.concatenate(machine.arc)
    marks = np.flatnonzero(np.diff(np.concatenate([[False], arc, [False]]).astype(int)))
    wanted = list(_stretches(layer.segments))
    spans = marks.reshape(-1, 2)
    if len(spans) != len(wanted):
        raise DryRunError(
            f'layer {layer.number}: the arc burnt {len(spans)} times, planned are {len(wanted)}'
        )
    for (a, b), laid in zip(spans.tolist(), wanted, strict=True):
        corners = np.array([laid[0].start, *(s.end for s in laid)]) + zero
        speeds = np.array([s.speed for s in laid])
        numbers = np.array([s.bead for s in laid])
        yield Bead(corners, speeds, tips[max(a - 1, 0) : b], numbers, layer.number, zero)


def _stretches(segments: list[Segment]) -> Iterator[list[Segment]]:
    """The deposits of every stretch with the arc on."""
    laid: list[Segment] = []
    for s in segments:
        if s.arc and s.kind == Kind.DEPOSIT and s.length > 0:
            laid.append(s)
        elif not s.arc and laid:
            yield laid
            laid = []
    if laid:
        yield laid
