"""The simulated cell fitted to recordings of others: misfit on the packaged parameters and on fitted ones.

Each recording shows one side of a cell: two sources (current against wire feed), two walls (cooling between layers), a
bent tube (height of a layer against travel speed). Only what it shows is fitted; the rest stays as packaged.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
from scipy.optimize import least_squares

from waam_lab.twin.electric import Steady, current, fit_current
from waam_lab.twin.unknowns import ELECTRIC, physics
from waam_sim import part
from waam_sim.compiled import jit, record
from waam_sim.heat import Heat, HeatParams, add_arc, conduct
from waam_sim.metal import bead_width
from waam_sim.plant import PlantParams

from . import adapt_wall
from .emit import emit
from .paths import DATA, SOURCES

USUAL = PlantParams()
BELIEF = 0.5  # standard deviation of logarithms that a recording may move


def _recordings() -> ModuleType:
    file = SOURCES / 'waam_sim' / 'bench' / 'compare_recordings.py'
    spec = importlib.util.spec_from_file_location('compare_recordings', file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def arc() -> tuple[float, float]:
    """A: RMS of the current of two sources, each fitted for itself; contact distance 15 mm, which neither tells."""
    read = _recordings()
    logs = (
        read.recorded_wall(DATA / 'wall_profiles' / 'arc_log.csv'),
        read.recorded_plate(DATA / 'arc_logs' / 'plate25_weld_params.csv'),
    )
    before, after = [], []
    for rows in logs:
        wire = rows[:, 0] / 60
        seen = Steady(
            wire, np.full(len(wire), 15e-3), rows[:, 1], rows[:, 2], np.zeros(len(wire), int)
        )
        found = fit_current(seen, USUAL.arc)
        assert found is not None
        values = {k.name: float(k.value(u)) for k, u in zip(ELECTRIC, found.u, strict=True)}
        for cell, misfits in ((USUAL, before), (physics(USUAL, values), after)):
            misfits.append(
                seen.current - current(cell.arc, wire * cell.arc.wire_ratio, seen.contact)
            )
    return tuple(_rms(np.concatenate(m)) for m in (before, after))


@jit
def _pass(skin, bulk, thickness, h, s, power, speed, x0, x1, y, wait, at_x, out, times):
    """One pass of the arc, then cooling; out (n,): skin at (at_x, y) so long after its end."""
    t, k = 0.0, 0
    length = abs(x1 - x0) / speed
    while t < length + wait:
        if t < length:
            add_arc(skin, thickness, h, s, x0 + (x1 - x0) * t / length, y, power * h.step)
        conduct(skin, bulk, thickness, h, s, h.step)
        t += h.step
        while k < times.size and t >= length + times[k]:
            out[k] = skin[int((y - s.origin_y) / h.cell), int((at_x - s.origin_x) / h.cell)]
            k += 1


def cooled(heat: HeatParams) -> np.ndarray:
    """(3,): excess temperature 10, 20 and 30 s after a layer over that after 5 s; mean of layers 3 to 8."""
    sim = Heat.of(part.plate(0.12, 0.012, 0.030, 1e-3, 0.012), heat)
    times, found = np.array([5.0, 10.0, 20.0, 30.0]), []
    for layer in range(8):
        ends = (0.01, 0.06) if layer % 2 else (0.11, 0.06)
        out = np.zeros(4)
        _pass(
            skin=sim.skin, bulk=sim.bulk, thickness=sim.thickness, h=sim.params[0], s=sim.state[0], power=2500.0,
            speed=0.01, x0=ends[0], x1=ends[1], y=0.006, wait=45.0, at_x=0.06, out=out, times=times,
        )  # fmt: skip
        excess = out - heat.ambient
        found.append(excess[1:] / excess[0])
    return np.mean(found[2:], axis=0)


def cooling() -> tuple[float, float]:
    """RMS of that ratio, over both walls. Fitted: conductivity, losses to table and air; it tells their balance."""
    read, folder = _recordings(), DATA / 'interlayer_temperature'
    before, after = [], []
    for file in sorted(folder.glob('*.csv')):
        seen = np.mean(read.recorded_cooling(file), axis=0)

        def cell(u: np.ndarray) -> HeatParams:
            names = ('conductivity', 'table_conductance', 'air_conductance')
            values = {
                n: getattr(USUAL.heat, n) * float(np.exp(v)) for n, v in zip(names, u, strict=True)
            }
            return replace(USUAL.heat, **values)

        def off(u: np.ndarray, seen: np.ndarray = seen) -> np.ndarray:
            return np.concatenate([(cooled(cell(u)) - seen) / 0.01, u / (3 * BELIEF)])

        found = least_squares(off, np.zeros(3), diff_step=0.05)
        for u, misfits in ((np.zeros(3), before), (found.x, after)):
            misfits.append(cooled(cell(u)) - seen)
    return tuple(_rms(np.concatenate(m)) for m in (before, after))


def layer_height() -> tuple[float, float]:
    """Relative RMS of the mean height of layers of the bent tube against their mean speed. Section over width of a
    bead; the exponent of speed and the ratio of metal to width are fitted, which are all that it tells."""
    r = adapt_wall.load('OL_hot')
    speed, grown = (1e-3 * r[k][10:, 3:45] for k in ('vel_set', 'dh'))
    # two layers together: the sensor lags, and they were laid in opposite directions
    speed, grown = (
        0.5 * (v[:-1:2] + v[1::2])
        for v in (speed[: len(speed) // 2 * 2], grown[: len(grown) // 2 * 2])
    )
    where = np.arange(speed.shape[1]) // 6
    pick = [
        np.nanmean(np.where(where == k, v, np.nan), axis=(0, 1))
        for k in range(7)
        for v in (speed, grown)
    ]
    v, dh = np.array(pick[::2]), np.array(pick[1::2])
    power = (
        float(np.nanmean(r['voltage'] * r['current'])) if 'current' in r else USUAL.metal.power_ref
    )

    def heights(u: np.ndarray) -> np.ndarray:
        m = replace(
            USUAL.metal,
            width_ref=USUAL.metal.width_ref * float(np.exp(u[0])),
            speed_exponent=USUAL.metal.speed_exponent + 0.1 * float(u[1]),
        )
        area = (
            0.25
            * np.pi
            * m.wire_diameter**2
            * adapt_wall.FEED
            * USUAL.arc.wire_ratio
            * m.transfer
            / v
        )
        width = np.array([bead_width(record(m)[0], power, s, 150.0) for s in v])
        return area / width

    def off(u: np.ndarray) -> np.ndarray:
        return np.concatenate([(heights(u) / dh - 1) / 0.03, u * (1 / BELIEF, 0.3)])

    found = least_squares(off, np.zeros(2))
    return tuple(_rms(heights(u) / dh - 1) for u in (np.zeros(2), found.x))


FIGURES: dict[str, tuple[str, float, Callable[[], tuple[float, float]], str]] = {
    'twin.misfit_current': ('A', 1.0, arc, 'arc_logs'),
    'twin.misfit_cooling': ('', 1.0, cooling, 'interlayer_temperature'),
    'twin.misfit_layer_height': ('%', 100.0, layer_height, 'bent_tube'),
}


def report() -> None:
    """One line per recording that is here."""
    for name, (unit, factor, measure, folder) in FIGURES.items():
        if not (DATA / folder).is_dir():
            print(f'{name}: no recordings in ../shared/data/{folder}', file=sys.stderr)
            continue
        before, after = (factor * v for v in measure())
        emit(name, after, unit, 'the packaged cell', round(before, 4))
