"""A recorded job laid once more on a simulated cell: the torch goes where it went, metal and heat answer with other
parameters. Every layer begins on the surface that was measured before it, so that errors do not add up.

This is some hundred times faster than the job in the laboratory: no controller, no scanner, no correction.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import distance_transform_edt

from waam_process.grid import GridSpec, HeightGrid
from waam_sim.arc import REFERENCE_CTWD
from waam_sim.compiled import SOURCES, bilinear, jit
from waam_sim.disturbance import lattice
from waam_sim.heat import BARE, Heat, add_arc, conduct, grow
from waam_sim.metal import Metal
from waam_sim.metal import advance as advance_metal
from waam_sim.plant import PlantParams
from waam_sim.pool import under_wire
from waam_sim.pyrometer import apparent
from waam_sim.step import AHEAD

from .records import JobRecord
from .timeline import STEP, Burning, Readings, burning, readings

BEYOND = 0.04  # m by which metal at the rim of the map goes on beyond it


def _make_lay(sources: int) -> Callable:
    @jit
    def lay(  # type: ignore[no-untyped-def]
        z, solid, touched, p, s, values, skin, bulk, thickness, h, hs, clock, t, x, y, height, lit, wire, power, dt,
        until, probe_t, probe_x, probe_y, probe_out, contact,
    ):  # fmt: skip
        """Lives through samples (n,), then waits until `until`. contact (n,): contact distance, m."""
        if not sources:
            return
        for i in range(t.size + 1):
            now = t[i] if i < t.size else until
            while now - clock[0] >= h.step:
                conduct(skin, bulk, thickness, h, hs, h.step)
                clock[0] += h.step
                k = int(clock[1])
                while k < probe_t.size and probe_t[k] <= clock[0]:
                    probe_out[k] = bilinear(
                        skin, hs.origin_x, hs.origin_y, h.cell, probe_x[k], probe_y[k], h.ambient
                    )
                    k += 1
                clock[1] = k
            if i == t.size:
                return
            surface = s.surface if s.active > 0.0 else under_wire(z, p, s, x[i], y[i])
            contact[i] = REFERENCE_CTWD + height[i] - surface
            base = bilinear(
                skin, hs.origin_x, hs.origin_y, h.cell,
                x[i] + AHEAD * s.head_x, y[i] + AHEAD * s.head_y, h.ambient,
            )  # fmt: skip
            if i == 0 or t[i] - t[i - 1] > 1.5 * dt:
                s.x, s.y = x[i], y[i]
            advance_metal(
                z=z, solid=solid, touched=touched, p=p, s=s, values=values, time=t[i], dt=dt, x=x[i], y=y[i],
                height_z=height[i], lit=lit[i] > 0.0, wire_speed=wire[i], power=power[i], temperature=base,
                ctwd=contact[i], gas=True,
            )  # fmt: skip
            if s.portion > 0.0:
                grow(skin, bulk, thickness, h, hs, s.portion_x, s.portion_y, s.portion)
                s.portion = 0.0
            if lit[i] > 0.0:
                add_arc(skin, thickness, h, hs, x[i], y[i], power[i] * dt)

    return lay


_lay = _make_lay(SOURCES)
_NO = np.zeros(0)
_EVEN = np.zeros((3, 64, 64, 64))  # of a cell that scatters nothing


@dataclass(frozen=True)
class Laid:
    """What the simulated cell did. `growth`: layer -> (rows, cols) m; `celsius`: what the pyrometer would have read at
    the times of the readings; `contact`: layer -> contact distance (n,) m of the samples."""

    growth: dict[int, np.ndarray]
    celsius: np.ndarray
    contact: dict[int, np.ndarray]


class Replay:
    """One recorded job, prepared. `run` lays it with any parameters."""

    def __init__(self, record: JobRecord) -> None:
        self.record = record
        self.layers: dict[int, Burning] = burning(record)
        self.readings: Readings = readings(record)
        self.ground = {one.number: one for one in record.layers if one.number in self.layers}
        self.first = filled(record.first, record.nominal)
        self.wide = HeightGrid(*_beyond(record.spec, self.first))

    @property
    def before_job(self) -> float:
        """Reading of the pyrometer before the first arc, degrees Celsius; NaN without one."""
        t = self.readings.t
        struck = min(float(b.t[0]) for b in self.layers.values())
        return float(self.readings.celsius[0]) if t.size and t[0] < struck else math.nan

    def run(self, physics: PlantParams, seed: int | None = None) -> Laid:
        """seed: of the scatter of beads; None = without any. ValueError: a metal model other than portions."""
        if (model := physics.metal.model) != 'portions':
            raise ValueError(
                f"metal_model is '{model}': recorded jobs are laid again with 'portions' only"
            )
        metal, heat = self._cold(physics, seed is not None)
        values = _EVEN if seed is None else lattice(seed)
        ratio = physics.arc.wire_ratio
        probe, out = self.readings, np.full(self.readings.t.size, np.nan)
        begin = min(float(b.t[0]) for b in self.layers.values())
        clock = np.array([min(begin, float(probe.t[0]) if probe.t.size else begin) - 1.0, 0.0])
        growth, contact = {}, {}
        for number, b in sorted(self.layers.items()):
            ground = self.ground.get(number)
            if ground is not None:
                metal.z[:] = np.where(np.isfinite(ground.before), ground.before, metal.z)
            metal.solid[:], metal.touched[:] = metal.z, -1e9
            before = metal.z.copy()
            contact[number] = np.zeros(b.t.size)
            self._live(metal, heat, values, clock, b, b.wire * ratio, (probe, out, contact[number]))
            growth[number] = metal.z - before
        end = float(probe.t[-1]) + 1.0 if probe.t.size else float(clock[0])
        nothing = Burning(*(_NO for _ in range(7)))
        self._live(metal, heat, values, clock, nothing, _NO, (probe, out, _NO), end)
        return Laid(growth, _read(out, physics), contact)

    def _cold(self, physics: PlantParams, scatter: bool) -> tuple[Metal, Heat]:
        spec = self.record.spec
        p = replace(physics.metal, cell=spec.resolution)
        if not scatter:
            p = replace(p, area_noise_fixed=0.0, area_noise_layer=0.0, width_noise=0.0)
        metal = Metal.on(HeightGrid(spec, self.first), p)
        return metal, Heat.of(self.wide, physics.heat)

    def _live(self, metal: Metal, heat: Heat, values: np.ndarray, clock: np.ndarray, b: Burning, wire: np.ndarray,
              shown: tuple[Readings, np.ndarray, np.ndarray], until: float = -math.inf) -> None:  # fmt: skip
        probe, out, contact = shown
        _lay(
            z=metal.z, solid=metal.solid, touched=metal.touched, p=metal.params[0], s=metal.state[0], values=values,
            skin=heat.skin, bulk=heat.bulk, thickness=heat.thickness, h=heat.params[0], hs=heat.state[0], clock=clock,
            t=b.t, x=b.x, y=b.y, height=b.z, lit=b.lit, wire=wire, power=b.power, dt=STEP, until=until,
            probe_t=probe.t, probe_x=probe.x, probe_y=probe.y, probe_out=out, contact=contact,
        )  # fmt: skip


def filled(z: np.ndarray, nominal: np.ndarray) -> np.ndarray:
    """z (rows, cols) m without gaps: what was not seen has the height of the nearest seen cell where the part is, and
    is the bare table elsewhere."""
    unseen = ~np.isfinite(z)
    if not unseen.any():
        return np.array(z, float)
    near = distance_transform_edt(unseen, return_distances=False, return_indices=True)
    return np.where(unseen, np.where(np.isfinite(nominal), z[tuple(near)], 0.0), z)


def _beyond(spec: GridSpec, z: np.ndarray) -> tuple[GridSpec, np.ndarray]:
    """Where metal reaches the rim of the map, the part goes on: heat flows there."""
    n = math.ceil(BEYOND / spec.resolution)
    sides = [z[0], z[-1], z[:, 0], z[:, -1]]
    low_y, high_y, low_x, high_x = (n if (side > BARE).mean() > 0.5 else 0 for side in sides)
    wide = np.pad(z, ((low_y, high_y), (low_x, high_x)), mode='edge')
    a = spec.resolution
    return GridSpec(spec.origin_x - a * low_x, spec.origin_y - a * low_y, a, *wide.shape), wide


def _read(true_c: np.ndarray, physics: PlantParams) -> np.ndarray:
    """Readings of the pyrometer (n,), degrees Celsius."""
    return np.array([apparent(float(c), physics.pyrometer, physics.heat.ambient) for c in true_c])
