"""The whole cell as one object: outputs of the controller go in sample by sample, its inputs and the sensors come out.

Nothing here knows of sockets, clocks or ROS: time comes with the samples, randomness from the seed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from waam_process.grid import HeightGrid

from . import part as parts
from .arc import REFERENCE_CTWD, Arc, ArcParams, advance_arc, advance_wire, wire_reading
from .compiled import SOURCES, bilinear, jit, random_state
from .disturbance import lattice
from .faults import Faults
from .heat import Heat, HeatParams, add_arc, conduct, grow
from .metal import Metal, MetalParams, under_wire
from .metal import advance as advance_metal
from .pyrometer import Pyrometer, PyrometerParams
from .scanner import Scanner, ScannerParams, profile
from .table import keep

SAMPLE = np.dtype(
    [
        ('table_x', '<f8'),
        ('table_y', '<f8'),
        ('tool_z', '<f8'),
        ('wire_cmd', '<f8'),
        ('voltage_set', '<f8'),
        ('outputs', '<u4'),
        ('pad', '<u4'),
    ]
)
OUTPUT_ARC, OUTPUT_GAS = 1, 2
INPUT_GAS_OK = 2
SAMPLE_US = 1000
AHEAD = 8e-3  # where the temperature that the bead meets is taken, ahead of the arc


@dataclass(frozen=True)
class PlantParams:
    """Parameters of all parts of the cell."""

    metal: MetalParams = field(default_factory=MetalParams)
    heat: HeatParams = field(default_factory=HeatParams)
    arc: ArcParams = field(default_factory=ArcParams)
    scanner: ScannerParams = field(default_factory=ScannerParams)
    pyrometer: PyrometerParams = field(default_factory=PyrometerParams)
    work_zero: tuple[float, float, float] = (0.100, 0.080, 0.020)


@dataclass(frozen=True)
class Reading:
    """What the controller's inputs see at the end of a step: bits, A, V, m/s."""

    inputs: int
    current: float
    voltage: float
    wire_speed: float


@dataclass(frozen=True)
class Profiles:
    """Profiles of one step: times (n,) in microseconds of the controller, z_s (n, points) m, intensity (n, points)."""

    time_us: np.ndarray
    z: np.ndarray
    intensity: np.ndarray


class Plant:
    """The simulated cell with one work-piece. Not thread-safe: one caller at a time."""

    def __init__(self, part: HeightGrid, params: PlantParams | None = None, seed: int = 1) -> None:
        self.params = params or PlantParams()
        self.faults = Faults()
        self.scanning = False
        self.time_us = 0
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
            self.metal.z = keep(part, table)
        self.heat = Heat.of(part, p.heat)
        self.arc = Arc.cold(p.arc, random_state(seed, 1))
        self.scanner = Scanner.of(p.scanner, random_state(seed, 2))
        self.pyrometer = Pyrometer(p.pyrometer, random_state(seed, 3))
        self._lattice = lattice(seed)
        self.aim(*parts.centre(part))
        self._zero = np.array(p.work_zero, float)

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
        return bool(self.arc.state['lit'][0] > 0.0)

    def step(self, samples: np.ndarray, time_us: int) -> Reading:
        """Simulates samples (n,) of SAMPLE, 1 ms each, the last at time_us."""
        metal, heat, arc, faults = self.metal, self.heat, self.arc, self.faults
        now = time_us * 1e-6
        blocked = gas_out = False
        slip = 0.0
        if faults.active:
            blocked, gas_out = faults.on('arc_loss', now), faults.on('gas_loss', now)
            slip = faults.share('wire_slip')
        self._before = self._last.copy()
        _live(
            samples, now, self._zero, self._last, metal.z, metal.solid, metal.touched, metal.params,
            metal.state, heat.skin, heat.bulk, heat.thickness, heat.params, heat.state, arc.params,
            arc.state, arc.line, arc.rng, self._lattice, blocked, gas_out, slip,
        )  # fmt: skip
        self.time_us = time_us
        s = arc.state[0]
        inputs = INPUT_GAS_OK if s['flow'] >= 1.0 else 0
        return Reading(
            inputs,
            float(s['current_read']),
            float(s['voltage_read']),
            float(wire_reading(arc.params[0], s)),
        )

    def profiles(self, samples: np.ndarray) -> Profiles | None:
        """The profiles exposed during the step just simulated; None when there is none."""
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
        spec = self.metal.spec
        top = float(self.metal.z.max())
        _scan(
            samples, times - first_us, self._zero, self._before, self.metal.z, spec.origin_x, spec.origin_y,
            spec.resolution, top, self.scanner.params, self.scanner.lateral, self.scanner.rng,
            self.faults.share('scanner_dropout'), z, intensity,
        )  # fmt: skip
        return Profiles(times, z, intensity)

    def temperature(self, dt: float) -> float:
        """A pyrometer reading `dt` s after the last, degrees Celsius."""
        stuck = self.faults.on('pyrometer_stuck', self.now)
        return self.pyrometer.read(self.heat.at(*self.spot), dt, stuck)


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


def _make_live(sources: int) -> Callable:
    @jit
    def live(
        samples, now, zero, last, z, solid, touched, mp, ms, skin, bulk, thickness, hp, hs, ap, als, line, rng,
        values, blocked, gas_out, slip,
    ):  # fmt: skip
        if not sources:
            return
        m, mstate, h, hstate, a, astate = mp[0], ms[0], hp[0], hs[0], ap[0], als[0]
        n = samples.size
        dt = 1e-3
        for i in range(n):
            x = -samples[i].table_x - zero[0]
            y = -samples[i].table_y - zero[1]
            height = samples[i].tool_z - zero[2]
            on = samples[i].outputs & 1 != 0
            gas = samples[i].outputs & 2 != 0 and not gas_out
            time = now - (n - 1 - i) * dt
            last[0], last[1], last[2] = x, y, height
            advance_wire(a, astate, line, rng, samples[i].wire_cmd, slip, dt)
            if astate.lit > 0.0 and mstate.active > 0.0:
                surface = mstate.surface
            elif on:
                surface = under_wire(z, m, mstate, x, y)
            else:
                surface = height
            ctwd = REFERENCE_CTWD + height - surface
            advance_arc(a, astate, rng, on, gas, blocked, samples[i].voltage_set, ctwd, dt)
            lit = astate.lit > 0.0
            power = astate.voltage * astate.current if lit else 0.0
            base = bilinear(
                skin, hstate.origin_x, hstate.origin_y, h.cell,
                x + AHEAD * mstate.head_x, y + AHEAD * mstate.head_y, h.ambient,
            )  # fmt: skip
            advance_metal(
                z,
                solid,
                touched,
                m,
                mstate,
                values,
                time,
                dt,
                x,
                y,
                height,
                lit,
                astate.wire,
                power,
                base,
                ctwd,
                gas,
            )
            if mstate.portion > 0.0:
                grow(
                    skin,
                    bulk,
                    thickness,
                    h,
                    hstate,
                    mstate.portion_x,
                    mstate.portion_y,
                    mstate.portion,
                )
                mstate.portion = 0.0
            if lit:
                add_arc(skin, thickness, h, hstate, x, y, power * dt)
            hstate.clock += dt
            if hstate.clock >= h.step - 1e-9:
                conduct(skin, bulk, thickness, h, hstate, hstate.clock)
                hstate.clock = 0.0

    return live


@jit
def _pose(samples, i, before, zero, out):
    """Position of the torch in the work frame at sample i; i = -1: at the end of the step before."""
    if i < 0:
        out[:] = before
        return
    out[0] = -samples[i].table_x - zero[0]
    out[1] = -samples[i].table_y - zero[1]
    out[2] = samples[i].tool_z - zero[2]


def _make_scan(sources: int) -> Callable:
    @jit
    def scan(
        samples, offsets_us, zero, before, z, origin_x, origin_y, cell, top, sp, lateral, rng, dropout, out, intensity
    ):  # fmt: skip
        """Profiles at times counted in us from the first sample; poses between samples are interpolated."""
        if not sources:
            return
        p = sp[0]
        a, b = np.empty(3), np.empty(3)
        for k in range(offsets_us.size):
            i = int(math.floor(offsets_us[k] / 1000.0))
            f = offsets_us[k] / 1000.0 - i
            _pose(samples, i, before, zero, a)
            _pose(samples, min(i + 1, samples.size - 1), before, zero, b)
            if np.isnan(a[0]):
                a[:] = b
            a += f * (b - a)
            profile(
                z,
                origin_x,
                origin_y,
                cell,
                top,
                p,
                lateral,
                rng,
                a[0],
                a[1],
                a[2],
                dropout,
                out[k],
                intensity[k],
            )

    return scan


_live = _make_live(SOURCES)
_scan = _make_scan(SOURCES)
