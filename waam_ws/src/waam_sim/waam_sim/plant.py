"""The whole cell as one object: outputs of the controller go in sample by sample, its inputs and the sensors come out.

Nothing here knows of sockets, clocks or ROS: time comes with the samples, randomness from the seed.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from waam_process.grid import HeightGrid
from waam_process.plant_port import SAMPLE

from . import part as parts
from .arc import CURRENT_READ, FLOW, LIT, VOLTAGE_READ, WIRE, Arc, ArcParams
from .compiled import Settled, random_state
from .delivered import CLOSED, TEST_CURRENT, TEST_VOLTAGE, Delivered, DeliveredParams
from .distance import NOTHING_WRONG, Distance, DistanceParams, Wrong
from .disturbance import lattice
from .faults import DIAL, Faults
from .gantry import Accelerations, Gantry, GantryParams
from .heat import Heat, HeatParams
from .metal import Metal
from .metal_models import number
from .metal_params import MetalParams
from .placement import Placement, PlacementParams
from .pyrometer import Pyrometer, PyrometerParams
from .robot import RobotParams
from .scanner import Scanner, ScannerParams
from .step import live, scan
from .table import keep
from .variation import Variation, VariationParams

OUTPUT_ARC, OUTPUT_GAS, OUTPUT_SENSING = 1, 2, 4
INPUT_GAS_OK = 2
INPUT_DRIVE_FAULT, INPUT_ACCELEROMETER = 32, 64
SAMPLE_US = 1000
NO_SAMPLES = np.empty((0, 3))


@dataclass(frozen=True)
class PlantParams:
    """Parameters of all parts of the cell."""

    metal: MetalParams = field(default_factory=MetalParams)
    heat: HeatParams = field(default_factory=HeatParams)
    arc: ArcParams = field(default_factory=ArcParams)
    scanner: ScannerParams = field(default_factory=ScannerParams)
    pyrometer: PyrometerParams = field(default_factory=PyrometerParams)
    part: PlacementParams = field(default_factory=PlacementParams)
    distance: DistanceParams = field(default_factory=DistanceParams)
    robot: RobotParams = field(default_factory=RobotParams)
    gantry: GantryParams = field(default_factory=GantryParams)
    variation: VariationParams = field(default_factory=VariationParams)
    delivered: DeliveredParams = field(default_factory=DeliveredParams)
    work_zero: tuple[float, float, float] = (0.100, 0.080, 0.020)


class Reading(NamedTuple):
    """What the controller's inputs see at the end of a step: bits, A, V, m/s; number and value of the newest reading of
    the distance sensor (mm, or counts of the infrared sensor, NaN = no echo); samples (n, 3) of the accelerometer in
    the step, m/s^2, none while the controller has it off."""

    inputs: int
    current: float
    voltage: float
    wire_speed: float
    distance: float = math.nan
    distance_reading: int = 0
    shaken: np.ndarray = NO_SAMPLES


@dataclass(frozen=True)
class Profiles:
    """Profiles of one step: times (n,) in microseconds of the controller, z_s (n, points) m, intensity (n, points)."""

    time_us: np.ndarray
    z: np.ndarray
    intensity: np.ndarray


class Plant:
    """The simulated cell with one work-piece. fed: wire so far, m; gassed: for how long gas has flowed, s.
    Not thread-safe: one caller at a time."""

    clamped: tuple[float, ...] = ()  # m, of a shaft in a chuck: nominal diameter, z of its surface

    def __init__(self, part: HeightGrid, params: PlantParams | None = None, seed: int = 1) -> None:
        self.params = params or PlantParams()
        self._model = number(self.params.metal.model)
        self._live = Settled(live)
        self.faults = Faults()
        self.scanning = self.sensing = self._on_robot = False
        self.time_us = 0
        self.fed = self.gassed = 0.0
        self._delivered = Delivered(self.params.delivered)
        self._lived = np.zeros(0, SAMPLE)
        self._last = np.full(3, np.nan)
        self._before = self._last.copy()
        self._next_profile_us = 0
        self.load(part, seed)

    def load(self, part: HeightGrid, seed: int, table: Path | None = None) -> None:
        """Clamps a cold part; everything random starts again from the seed. `table`: file that keeps its surface."""
        p = self.params
        self.seed = seed
        self.metal = Metal.on(part, p.metal)
        if table is not None:
            self.metal.z = keep(part, table, self.clamped)
        self.heat = Heat.of(part, p.heat)
        self.arc = Arc.cold(p.arc, random_state(seed, 1))
        self.scanner = self._mounted()
        self.variation = Variation.of(p.variation, seed)
        self.pyrometer = Pyrometer(p.pyrometer, random_state(seed, 3), p.heat.ambient)
        self.distance = Distance(p.distance, random_state(seed, 4))
        self.gantry = Gantry(p.gantry, random_state(seed, 6), parts.volume(part))
        self._was_scanning = False
        self._lattice = lattice(seed)
        middle = parts.centre(part)
        self.placed = Placement.flat(p.part, self.heat.spec, middle, random_state(seed, 5))
        self.aim(*middle)
        self._zero = np.array(p.work_zero, float)

    def follow(self, other: Plant) -> None:
        """Goes on in the cell of `other`, where this part is clamped in place of its own."""
        self.faults, self.scanning, self.sensing = other.faults, other.scanning, other.sensing
        self.time_us, self.fed, self.gassed = other.time_us, other.fed, other.gassed

    def put_on_robot(self) -> None:
        """A robot carries the scanner: its scans share `robot_scan_error`, not the error of a gantry."""
        self._on_robot = True
        self.scanner = self._mounted()

    def _mounted(self) -> Scanner:
        p = self.params.scanner
        if self._on_robot:
            p = dataclasses.replace(p, shared_error=self.params.robot.scan_error)
        return Scanner(self.params.delivered.mounted(p), self.seed)

    def aim(self, x: float, y: float) -> None:
        """Turns the pyrometer to a point (m, work frame); one with a spot of its own stays there."""
        fixed = self.params.pyrometer
        self.spot = (
            x if math.isnan(fixed.spot_x) else fixed.spot_x,
            y if math.isnan(fixed.spot_y) else fixed.spot_y,
        )

    @property
    def now(self) -> float:
        """Controller time, s."""
        return self.time_us * 1e-6

    @property
    def arc_on(self) -> bool:
        """Whether the arc burns."""
        return self.arc.value(LIT) > 0.0

    @property
    def torch(self) -> tuple[float, float, float]:
        """Where the torch truly is over the table, m, machine; NaN before the first step."""
        x, y, z = (self._last + self._zero).tolist()
        return x, y, z

    @property
    def spot_temperature(self) -> float:
        """True one where the pyrometer looks, degrees Celsius."""
        return self.heat.at(*self.spot) + self.faults.share('warm_hand')

    def placed_samples(self, samples: np.ndarray) -> np.ndarray:
        """Samples of the plant port (n,) of SAMPLE as `step` takes them: places of the axes in m."""
        return samples

    def step(self, samples: np.ndarray, time_us: int) -> Reading:
        """Simulates samples (n,) of SAMPLE, 1 ms each, the last at time_us."""
        metal, heat, arc, faults, placed = self.metal, self.heat, self.arc, self.faults, self.placed
        vary = self.variation
        wired = self.params.delivered
        now = time_us * 1e-6
        samples = self._delivered.moved(samples)
        if self.params.gantry.on:
            asked = bool(samples['outputs'][-1] & OUTPUT_SENSING)
            samples = self.gantry.move(samples, metal.deposited, asked or self.sensing)
        self._lived = samples
        blocked = empty = False
        gas_out = wired.gas_valve == CLOSED
        slip = 0.0
        if faults.active:
            blocked, gas_out = faults.on('arc_loss', now), gas_out or faults.on('gas_loss', now)
            slip, empty = faults.share('wire_slip'), faults.on('wire_end', now)
        self._note_scan()
        self._before[:] = self._last
        arrays = (
            self._zero, self._last, metal.z, metal.solid, metal.touched, metal.params, metal.state, heat.skin,
            heat.bulk, heat.thickness, heat.params, heat.state, arc.params, arc.state, arc.line, arc.rng,
            self._lattice, placed.hot, placed.kept, placed.params, placed.state, vary.params, vary.state, vary.key,
        )  # fmt: skip
        samples = np.ascontiguousarray(samples, SAMPLE)
        self._live(arrays, samples, now, blocked, gas_out, slip, empty, self._model)
        self.time_us = time_us
        self._measure_distance(len(samples) * SAMPLE_US * 1e-6)
        took = len(samples) * SAMPLE_US * 1e-6
        self.fed += arc.value(WIRE) * took
        flows = arc.value(FLOW) >= 1.0
        self.gassed += took if flows else 0.0
        inputs = INPUT_GAS_OK if flows else 0
        if faults.active:
            pressed = faults.on('estop_pressed', now), faults.on('limit_pressed', now)
            inputs |= wired.inputs(*pressed)
        else:
            inputs |= self._delivered.at_rest
        if faults.active and faults.on('drive_fault', now):
            inputs |= INPUT_DRIVE_FAULT
        shaken = NO_SAMPLES
        if self.params.gantry.on:
            inputs |= INPUT_ACCELEROMETER
            seen = self.accelerations()
            shaken = shaken if seen is None else seen.values
        return Reading(
            inputs,
            wired.current(arc.value(CURRENT_READ) + faults.share(TEST_CURRENT)),
            wired.voltage_scale * (arc.value(VOLTAGE_READ) + faults.share(TEST_VOLTAGE)),
            arc.read_wheel(),
            self.distance.value,
            self.distance.reading,
            shaken,
        )

    def _note_scan(self) -> None:
        """A part that is moved after it was scanned is moved when the first scan is over. A layer begins after a
        scan."""
        if self._was_scanning and not self.scanning:
            self.scanner.switch(False)
            self.variation.scanned()
            self.placed.state['moved'] = 1.0
        self._was_scanning = self.scanning

    def _measure_distance(self, dt: float) -> None:
        """Readings of the distance sensor in the `dt` s of a step; only the newest is kept."""
        sensor = self.distance
        (x, y, _), (from_x, from_y, _) = self._last.tolist(), self._before.tolist()
        if not math.isnan(x - from_x):
            sensor.turn(x - from_x, y - from_y)
        if count := sensor.pass_time(dt):
            spec, placed = self.metal.spec, self.placed
            surface = (
                self.metal.z, spec.origin_x, spec.origin_y, spec.resolution, placed.hot, placed.kept,
                placed.params, placed.state,
            )  # fmt: skip
            sensor.measure(surface, self._last, self.arc_on, self._wrong(), count, dt)

    def _wrong(self) -> Wrong:
        """The faults of the distance sensor that are in force."""
        if not self.faults.active:
            return NOTHING_WRONG
        f, now = self.faults, self.now
        return Wrong(
            dead=f.on('distance_dead', now),
            stuck=f.on('distance_stuck', now),
            inverted=f.on('distance_inverted', now),
            drift=f.share('distance_drift'),
            unit=f.share('distance_unit') or 1.0,
            dropout=f.share('distance_dropout'),
        )

    def surface(self) -> HeightGrid:
        """A copy of the true surface as the part lies now, work frame."""
        spec = self.metal.spec
        return HeightGrid(spec, self.placed.over(spec, self.metal.z))

    def accelerations(self) -> Accelerations | None:
        """What the accelerometer saw in the step just simulated; None when it is off or the axes are rigid."""
        return self.gantry.accelerations(self.time_us) if self.params.gantry.on else None

    def profiles(self, samples: np.ndarray) -> Profiles | None:
        """The profiles exposed during the step just simulated; None when there is none."""
        if self.params.gantry.on or not self._delivered.as_ordered:
            samples = self._lived
        self.scanner.switch(self.scanning)
        period = round(1e6 / self.params.scanner.rate)
        first_us = self.time_us - SAMPLE_US * (len(samples) - 1)
        if not self.scanning or self.faults.on('scanner_dead', self.now):
            self._next_profile_us = 0
            return None
        if not first_us - SAMPLE_US < self._next_profile_us <= self.time_us + period:
            self._next_profile_us = -(-(first_us - SAMPLE_US + 1) // period) * period
        times = np.arange(self._next_profile_us, self.time_us + 1, period)
        if not len(times):
            return None
        self._next_profile_us = int(times[-1]) + period
        return self._expose(samples, times, first_us)

    def _expose(self, samples: np.ndarray, times: np.ndarray, first_us: int) -> Profiles:
        n = self.scanner.lateral.size
        z, intensity = np.empty((len(times), n), np.float32), np.empty((len(times), n), np.float32)
        spec, placed = self.metal.spec, self.placed
        top = float(self.metal.z.max())
        scan(
            samples=samples, offsets_us=times - first_us, zero=self._zero, before=self._before, z=self.metal.z,
            origin_x=spec.origin_x, origin_y=spec.origin_y, cell=spec.resolution, top=top, hot=placed.hot,
            kept=placed.kept, lp=placed.params, ls=placed.state, sp=self.scanner.params, lateral=self.scanner.lateral,
            rng=self.scanner.rng, place=self.scanner.place, shared=self.scanner.shared,
            dropout=self.faults.share('scanner_dropout'), out=z, intensity=intensity,
        )  # fmt: skip
        return Profiles(times + round(1e6 * self.params.delivered.scanner_late), z, intensity)

    def temperature(self, dt: float) -> float:
        """A pyrometer reading `dt` s after the last, degrees Celsius."""
        stuck = self.faults.on('pyrometer_stuck', self.now)
        ambient = self.params.heat.ambient
        true = self.params.delivered.temperature(self.spot_temperature, ambient)
        return self.pyrometer.read(true, dt, stuck, self.faults.share(DIAL) or 1.0)


def warm_up(params: PlantParams | None = None) -> None:
    """Compiles everything (or loads it from numba's cache) on a small part, so that the first step is quick."""
    params = params or PlantParams()
    often = dataclasses.replace(params, scanner=dataclasses.replace(params.scanner, rate=1000.0))
    tiny = Plant(parts.plate(0.02, 0.02, 0.01, params.metal.cell, 2e-3), often, 0)
    tiny.scanning = True
    samples = np.zeros(10, SAMPLE)
    tiny.step(samples, 10_000)
    tiny.profiles(samples)
    tiny.temperature(0.1)
    parts.rasterise(np.zeros((2, 2)), np.zeros((1, 3, 3)), 0.0, 0.0, 1.0)
