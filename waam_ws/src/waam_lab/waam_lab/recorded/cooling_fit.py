"""Cooling curves: a wall of the simulated heat, one bead wide, is passed by the arc and cools. Of every recorded curve
two numbers are free, the heat that the pass gave and how warm the wall was; its shape tells conduction and losses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from waam_process.grid import GridSpec, HeightGrid
from waam_sim.compiled import SOURCES, jit
from waam_sim.heat import Heat, HeatParams, add_arc, conduct

from ..twin.records import RecordError
from .cooling_curves import FIRST, Curve, curves
from .finding import Figure, Finding, Parameter

LENGTH, HEIGHT = 0.10, 0.04  # m, of the wall that is assumed; it is one heat cell (4 mm) wide
SPEED, POWER = 8e-3, 2000.0  # m/s, W electrical of the pass
SPREAD = {
    'conductivity': 0.45,
    'table_conductance': 0.9,
    'air_conductance': 0.7,
}  # of logarithms, before
TELLS = 0.7  # of what was believed before is left at most, as for jobs
AGAIN = 6.0  # neighbouring readings err alike: so many count as one
ROUNDS = 6
AFTER = (10.0, 20.0, 30.0)  # s, of the figures
SILENT = (
    'the heat of a pass (power times efficiency) and the temperature of the wall before it: free for every curve',
    f'length, width and height of the wall: {LENGTH * 1e3:.0f} x 4 x {HEIGHT * 1e3:.0f} mm are assumed; conduction and '
    'losses are those of such a wall',
    'heat_heat_capacity: only conductivity over capacity shows, and the capacity stays that of steel',
    'heat_emissivity: takes heat away much as heat_air_conductance does, which takes what is left',
    f'the first {FIRST:.0f} s after a peak: melt, spatter and light of the arc',
)


def _make() -> Callable:
    SOURCES  # noqa: B018  part of the key of numba's cache

    @jit
    def run(skin, bulk, thickness, p, s, steps, dt, x0, speed, y, end, power, out):  # type: ignore[no-untyped-def]
        """Skin temperature (steps,) at the middle while an arc of `power` moves from x0 to `end` along y."""
        middle = skin.shape[1] // 2
        for k in range(steps):
            x = x0 + speed * k * dt
            if power > 0.0 and x <= end:
                add_arc(skin, thickness, p, s, x, y, power * dt)
            conduct(skin, bulk, thickness, p, s, dt)
            out[k] = skin[1, middle]

    return run


_run = _make()


def responses(
    p: HeatParams, warm: float, seconds: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """After the peak of a pass: times (n,) s, what the pass adds (n,) K, and what is left of a warm wall's temperature
    above the ambient (n,), 1 at the peak. warm: degrees Celsius of the wall before."""
    cell, dt = p.cell, p.step
    cols = int(LENGTH / cell) | 1
    spec = GridSpec(0.0, 0.0, cell, 3, cols)
    z = np.zeros(spec.shape)
    z[1] = HEIGHT
    way = LENGTH / 2 / SPEED
    steps = int((way + seconds + 10.0) / dt)
    found = []
    for power in (POWER, 0.0):
        heat = Heat.of(HeightGrid(spec, z), p)
        for field in (heat.skin, heat.bulk):
            field[1] = warm
        out = np.zeros(steps)
        _run(
            skin=heat.skin,
            bulk=heat.bulk,
            thickness=heat.thickness,
            p=heat.params[0],
            s=heat.state[0],
            steps=steps,
            dt=dt,
            x0=cell * 0.5,
            speed=SPEED,
            y=cell * 1.5,
            end=LENGTH,
            power=power,
            out=out,
        )
        found.append(out)
    hot, plain = found
    top = int(np.argmax(hot - plain))
    above = np.maximum(plain - p.ambient, 1e-3)
    return np.arange(steps - top) * dt, (hot - plain)[top:], above[top:] / above[top]


def fitted(
    p: HeatParams, one: Curve, answer: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> np.ndarray:
    """(n,) degrees Celsius: the best sum of pass and warm wall for a curve."""
    t, hot, warm = answer
    use = one.t >= FIRST
    design = np.stack([np.interp(one.t, t, hot), np.interp(one.t, t, warm)], axis=1)
    share, _ = nnls(design[use], one.celsius[use] - p.ambient)
    return p.ambient + design @ share


def _off(p: HeatParams, found: list[Curve], warm: float) -> np.ndarray:
    seconds = max(float(c.t[-1]) for c in found)
    answer = responses(p, warm, seconds)
    return np.concatenate([(fitted(p, c, answer) - c.celsius)[c.t >= FIRST] for c in found])


def _ratios(found: list[Curve], values: list[np.ndarray]) -> list[float]:
    """Means over the curves of the temperature after 10, 20, 30 s over that after 5 s."""
    out = []
    for after in AFTER:
        told = [
            float(np.interp(after, c.t, v) / np.interp(FIRST, c.t, v))
            for c, v in zip(found, values, strict=True)
            if c.t[-1] >= after
        ]
        out.append(float(np.mean(told)) if told else float('nan'))
    return out


def fit_cooling(
    name: str, t: np.ndarray, celsius: np.ndarray, base: HeatParams
) -> tuple[Finding, HeatParams]:
    """t (n,) s, celsius (n,). RecordError when no place cools for long enough."""
    found, notes = curves(t, celsius)
    if not found:
        raise RecordError(
            f'{name}: no cooling curve; {"; ".join(notes) or "it never gets warmer by 30 K"}'
        )
    warm = float(np.median([c.celsius[-1] for c in found]))
    spread = np.array(list(SPREAD.values()))

    def cell(u: np.ndarray) -> HeatParams:
        factors = np.exp(np.clip(u, -3.0, 3.0) * spread)
        values = {k: getattr(base, k) * f for k, f in zip(SPREAD, factors, strict=True)}
        values['conductivity'] = float(
            np.clip(values['conductivity'], 1.0, 120.0)
        )  # explicit steps stay stable
        return replace(base, **{k: float(v) for k, v in values.items()})

    free = np.ones(len(SPREAD), bool)
    u, left = _solve(lambda v: _off(cell(v), found, warm), free)
    told = left <= TELLS
    if (
        told.any() and not told.all()
    ):  # what is not told stays as it was, so the rest is sought anew
        u, again = _solve(lambda v: _off(cell(v), found, warm), told)
        left = np.where(told, again, left)
    values = {k: getattr(cell(u), k) for k, able in zip(SPREAD, told, strict=True) if able}
    kept = replace(base, **values)
    parameters = [
        Parameter.relative(
            f'heat_{k}', getattr(cell(u), k), float(share * s), getattr(base, k), bool(able)
        )
        for (k, s), share, able in zip(SPREAD.items(), left, told, strict=True)
    ]
    rms = [float(np.sqrt(np.mean(_off(p, found, warm) ** 2))) for p in (base, kept)]
    return (
        Finding(
            name,
            'cooling curves',
            (rms[0], rms[1]),
            'K, RMS',
            tuple(parameters),
            _shown(found, base, kept, warm),
            SILENT,
            (f'{len(found)} cooling curves', *notes),
        ),
        kept,
    )


def _shown(
    found: list[Curve], base: HeatParams, kept: HeatParams, warm: float
) -> tuple[Figure, ...]:
    seconds = max(float(c.t[-1]) for c in found)
    told = _ratios(found, [c.celsius for c in found])
    cells = []
    for p in (base, kept):
        answer = responses(p, warm, seconds)
        cells.append(_ratios(found, [fitted(p, c, answer) for c in found]))
    return tuple(
        Figure(f'temperature after {a:.0f} s over that after {FIRST:.0f} s', '', r, b, c)
        for a, r, b, c in zip(AFTER, told, *cells, strict=True)
        if np.isfinite(r)
    )


def _solve(
    off: Callable[[np.ndarray], np.ndarray], free: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Standard values (3,) and what of the belief before is left (3,): Gauss-Newton with that belief. free: (3,) which
    of them may move."""
    n = len(SPREAD)
    u = np.zeros(n)
    best = off(u)
    precision = np.eye(n)
    for _ in range(ROUNDS):
        slopes = np.stack([(off(u + d) - off(u - d)) / 0.4 for d in 0.2 * np.eye(n)], axis=1) * free
        scale = 1.0 / (AGAIN * max(float(np.mean(best**2)), 1.0))
        precision = slopes.T @ slopes * scale + np.eye(n)
        step = -np.linalg.solve(precision, slopes.T @ best * scale + u)
        for shorter in (1.0, 0.5, 0.25):
            new = np.clip(u + shorter * step, -3.0, 3.0)
            there = off(new)
            if float(there @ there) < float(best @ best):
                u, best = new, there
                break
        else:
            break
    return u, np.sqrt(np.diag(np.linalg.inv(precision)))
