"""Wrong maps, corrections and temperatures in whole jobs of the laboratory: what does the job do with them?

Each case alters what one part of the cell tells the job, from the second layer on or once. The last scan is never
altered, so the figures of the job are true. `said`: the job failed with a reason of its own, or named what it saw in a
warning; `harmless`: the part came out as of an undisturbed job, up to HARMLESS of its RMS. A case that is neither was
wrong in silence.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from waam_adapt.conversions import heat_to_msg
from waam_job.conversions import correction_from_msg, heat_from_msg
from waam_lab import laboratory, restore
from waam_lab.cell import LabCell
from waam_msgs.msg import CorrectionMap, HeatFactor, HeightMap
from waam_sim.plant import Profiles

from .preset import preset

HARMLESS = 1.25  # of the RMS of the undisturbed job
ABOUT = {'scan', 'correction', 'temperature', 'node'}  # anomalies that may name the cause


@dataclass(frozen=True)
class Case:
    """What is altered: profiles, the finished map, the correction or the heat; once: in the scan after layer 1 only."""

    profiles: Callable[[Profiles], Profiles] | None = None
    map: Callable[[HeightMap], None] | None = None
    correction: Callable[[CorrectionMap], None] | None = None
    heat: Callable[[HeatFactor], None] | None = None
    once: bool = False


def _heights(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Profiles], Profiles]:
    return lambda p: replace(p, z=change(p.z.copy()))


def _half_gone(z: np.ndarray) -> np.ndarray:
    z[:, : z.shape[1] // 2] = np.nan
    return z


def _z(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[HeightMap], None]:
    def alter(m: HeightMap) -> None:
        m.z = change(np.asarray(m.z, np.float32).copy()).astype(np.float32)

    return alter


def _old(m: HeightMap) -> None:
    m.header.stamp.sec -= 3600


def _other_grid(m: HeightMap) -> None:
    m.grid.origin.position.x += 5e-3


def _other_shape(m: HeightMap) -> None:
    m.grid.rows, m.grid.cols = m.grid.cols, m.grid.rows


def _other_layer(m: HeightMap) -> None:
    m.layer += 7


def _set(**values: Any) -> Callable[[Any], None]:
    """Of a map every cell, of a number the number."""

    def alter(m: Any) -> None:
        for name, value in values.items():
            old = getattr(m, name)
            plain = isinstance(old, (float, bool, str))
            setattr(m, name, value if plain else np.full(len(old), value, np.float32))

    return alter


class _Frozen:
    """The first profile of all, again and again."""

    def __init__(self) -> None:
        self._first: np.ndarray | None = None

    def __call__(self, p: Profiles) -> Profiles:
        self._first = p.z[:1].copy() if self._first is None else self._first
        return replace(p, z=np.repeat(self._first, len(p.z), axis=0))


POINTS_PER_MM = 640 / 50  # of the simulated profiler
CASES = {
    'profiles 3 mm to the side': Case(
        _heights(lambda z: np.roll(z, round(3 * POINTS_PER_MM), axis=1))
    ),
    'profiles mirrored': Case(_heights(lambda z: z[:, ::-1])),
    'profiles half NaN': Case(_heights(_half_gone)),
    'profiles all NaN': Case(_heights(lambda z: np.full_like(z, np.nan))),
    'profiles 0.5 mm higher, once': Case(_heights(lambda z: z + np.float32(0.5e-3)), once=True),
    'profiles upside down': Case(_heights(lambda z: 2 * np.nanmedian(z) - z)),
    'profiles frozen': Case(_Frozen()),
    'map all NaN': Case(map=_set(z=math.nan)),
    'map of infinities': Case(map=_set(z=math.inf)),
    'map 4 mm higher': Case(map=_z(lambda z: z + 4e-3)),
    'map an hour old': Case(map=_old),
    'map of another grid': Case(map=_other_grid),
    'map of another shape': Case(map=_other_shape),
    'map of another job': Case(map=_set(job_id='another')),
    'map of another layer': Case(map=_other_layer),
    'correction of NaN': Case(correction=_set(psi=math.nan)),
    'correction beyond its limits': Case(correction=_set(psi=50.0)),
    'correction with residual of 1 m': Case(correction=_set(residual_height=1.0)),
    'flow factor NaN': Case(correction=_set(flow_factor=math.nan)),
    'flow factor 0': Case(correction=_set(flow_factor=0.0)),
    'flow factor 30': Case(correction=_set(flow_factor=30.0)),
    'temperature NaN': Case(heat=_set(temperature=math.nan)),
    'temperature of 2500 degrees': Case(heat=_set(temperature=2500.0, ready=True)),
    'temperature of -300 degrees': Case(heat=_set(temperature=-300.0, ready=True)),
    'heat factor NaN': Case(heat=_set(factor=math.nan)),
    'heat factor 0': Case(heat=_set(factor=0.0)),
    'heat factor 5': Case(heat=_set(factor=5.0)),
}


class Altered(LabCell):
    """A cell that tells what the case says, from the layer after the first on, but for the last scan."""

    case = Case()
    last = 4  # number of layers: the scan after it is true

    def __init__(self, *args) -> None:
        super().__init__(*args)
        self._layer = 0
        scanning, told = self.scanning, self.scanning.on_profiles
        finish = scanning.finish

        def on_profiles(profiles: Profiles) -> None:
            change = self.case.profiles
            told(change(profiles) if change and self._alters() else profiles)

        def altered_map(scan_id: int, until: float) -> HeightMap:
            message = finish(scan_id, until)
            if self.case.map and self._alters():
                self.case.map(message)
            return message

        self.device.on_profiles, scanning.finish = on_profiles, altered_map

    def begin_scan(self, job_id, layer, spec, laid):
        """Remembers the layer, as the cases go by it."""
        self._layer = layer
        return super().begin_scan(job_id, layer, spec, laid)

    def _alters(self) -> bool:
        return self._layer == 1 if self.case.once else 1 <= self._layer < self.last

    def correct(self, job_id, request):
        """Altered from the second layer on."""
        answer = super().correct(job_id, request)
        if self.case.correction is None or request.layer == 1:
            return answer
        self.case.correction(answer.handle)
        return correction_from_msg(answer.handle, answer.learned)

    def heat(self):
        """Altered once a layer was laid."""
        if self.case.heat is None or self._layer < 1:
            return super().heat()
        message = heat_to_msg(
            self.thermal.state(self.now()), self.thermal.limit, self.thermal.material
        )
        self.case.heat(message)
        return heat_from_msg(message)


def _write_part(folder: Path) -> tuple[Path, Path]:
    """Nominal and worn block of 36 x 30 x 12 mm with a trough that no mirror maps onto itself."""
    from waam_node.stl import write_worn_block

    x, y = np.linspace(0, 36, 37), np.linspace(0, 30, 31)
    gx, gy = np.meshgrid(x, y)
    away = np.maximum(np.abs(gx - 16) / 14, np.abs(gy - 12) / 10)
    return write_worn_block(folder, x, y, 12.0, 4.0 * np.clip(1.5 - 1.5 * away, 0, 1))


def run_case(folder: Path, name: str, seed: int, whole: float = math.nan) -> dict:
    """One job with the case `name` ('' = undisturbed). whole: m, RMS of the undisturbed job."""
    nominal, worn = _write_part(folder)
    job = restore(nominal, worn, seed, layer_height=1.4e-3, preset=preset())

    class Cell(Altered):
        case = CASES[name] if name else Case()

    kept, laboratory.LabCell = laboratory.LabCell, Cell
    try:
        result = laboratory.run(job)
    except Exception as e:  # a traceback in the face of the operator is a fault of ours
        return {'ended': f'{type(e).__name__}: {e}', 'right': False}
    finally:
        laboratory.LabCell = kept
    named = [a for a in result.anomalies if a['class'] in ABOUT]
    crashed = result.error_code == 100  # UNKNOWN: an error that nobody expected
    said = (result.failed and not crashed) or bool(named)
    harmless = bool(result.rms <= HARMLESS * whole)
    return {
        'ended': result.verdict, 'message': result.message, 'layers': result.layers,
        'rms_mm': round(result.rms * 1e3, 4) if math.isfinite(result.rms) else None,
        'said': said, 'harmless': harmless, 'right': said or harmless,
        'warnings': [f"{a['class']}: {a['text']}" for a in named][:4],
    }  # fmt: skip
