"""A single-bead wall as its scans show it: the same figures of the recorded wall and of simulated ones.

Recorded: `wall_profiles` (four scans: before the wall and after layers 1 to 3; arc log). Simulated: the same three
beads (heights, travel speeds, wire feeds, voltages, pauses and directions of the log) and the same scans (1024 points,
profiles 1 mm apart). Lengths m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

ENDS = 10e-3  # m at each end of the wall that do not count
LAYERS = 3
PLATE = (0.08, 0.08, 0.012)  # m
FIRST, LAST, AXIS = 0.015, 0.065, 0.04  # m, x of the ends of the simulated wall, y of it
ROW, ACROSS = 1e-3, 1e-4  # m, between profiles, and between heights of a section
HALF = 6e-3  # m, half of the section that is looked at
NEAR = 15e-3  # m from the axis, where the plate is looked at
CROWN = 1.2e-3  # m, half width of the parabola that is fitted to the crown
STRIP = (6e-3, 14e-3)  # m from the axis, where the plate beside the wall is seen


@dataclass(frozen=True)
class Pass:
    """One bead of the log: torch height over that of the first one, m; m/s; m/s; V; s before it; along +x."""

    up: float
    speed: float
    wire: float
    voltage: float
    pause: float
    forward: bool


@dataclass(frozen=True)
class Section:
    """Of the scan after a layer, by x (n,): crown, whole section (m^2), width and middle at half height."""

    x: np.ndarray
    top: np.ndarray
    area: np.ndarray
    width: np.ndarray
    middle: np.ndarray


def recorded(folder: Path) -> tuple[list[np.ndarray], list[Pass]]:
    """Points (n, m, 3) of the scans after layers 1 to 3, about the axis of the wall, and what the log says of it."""
    from waam_lab.recorded import wall

    made, log = wall.read_wall(folder, 5e-4)
    points = [wall.profile_points(s, made.shift) for s in made.scans]
    for p in points:
        p[..., 1] -= made.bead.axis
    return points, _passes(log)


def _passes(log) -> list[Pass]:
    edges = np.flatnonzero(np.diff(log.arc.astype(int)))
    rows = [slice(a + 1, b + 1) for a, b in zip(edges[::2], edges[1::2], strict=False)][:LAYERS]
    found, end = [], None
    for row in rows:
        place, later = (
            log.position[row],
            slice(row.start + 20, row.stop - 4),
        )  # from 1 s after the start
        found.append(
            Pass(
                up=float(np.median(place[:, 2])),
                speed=float(np.median(log.speed[row])),
                wire=float(np.median(log.wire_feed[later])),
                voltage=float(np.median(log.voltage[later])),
                pause=0.0 if end is None else max(float(log.t[row.start]) - end, 0.0),
                forward=bool(place[-1, 0] > place[0, 0]),
            )
        )
        end = float(log.t[row.stop - 1])
    return [replace(p, up=p.up - found[0].up) for p in found]


def simulated(physics, passes: list[Pass], seed: int) -> list[np.ndarray]:
    """Points (n, m, 3) of the scans before the wall and after each layer, of one simulated cell."""
    from waam_sim import part
    from waam_sim.drive import Drive
    from waam_sim.plant import Plant

    scanner = replace(physics.scanner, points=1024, fan=0.066, rate=10.0)
    arc = replace(physics.arc, strike_failure=0.0)
    physics = replace(physics, scanner=scanner, arc=arc)
    plant = Plant(part.plate(*PLATE, physics.metal.cell, 0.01), physics, seed)
    drive = Drive(plant, (0.0, AXIS, 0.05))
    scans = [_scan(drive, 0.012)]
    for p in passes:
        drive.wait(max(p.pause - 15.0, 0.1))
        z = PLATE[2] + p.up
        ends = [(FIRST, AXIS, z), (LAST, AXIS, z)]
        drive.bead(ends if p.forward else ends[::-1], p.speed, p.wire, p.voltage)
        scans.append(_scan(drive, 0.012 + p.up))
    return scans


def _scan(drive, low: float) -> np.ndarray:
    """Profiles over the wall, 1 mm apart."""
    plant, scanner = drive.plant, drive.plant.params.scanner
    high = low + 0.004
    back = scanner.offset_x
    drive.move((FIRST - 0.012 - back, AXIS, high + 0.02), 0.1)
    drive.move((FIRST - 0.012 - back, AXIS, high), 0.1)
    drive.profiles.clear()
    plant.scanning = True
    first_us, start = drive.time_us, drive.position[0]
    speed = ROW * scanner.rate
    drive.move((LAST + 0.012 - back, AXIS, high), speed)
    plant.scanning = False
    drive.wait(0.01)
    found = [(t, z) for p in drive.profiles for t, z in zip(p.time_us, p.z, strict=True)]
    out = np.empty((len(found), scanner.points, 3))
    for k, (t, z) in enumerate(found):
        out[k, :, 0] = start + back + (t - first_us) * 1e-6 * speed
        out[k, :, 1] = plant.scanner.lateral
        out[k, :, 2] = high + scanner.offset_z + z
    drive.move((drive.position[0], AXIS, high + 0.03), 0.1)
    return out


def crown(y: np.ndarray, z: np.ndarray) -> float:
    """Highest value (m) of a parabola fitted to points (n,) across the crown, without points further than four robust
    standard deviations. NaN with fewer than eight points."""
    use = np.ones(len(y), bool)
    for _ in range(3):
        if use.sum() < 8:
            return np.nan
        p = np.polyfit(y[use], z[use], 2)
        residual = np.abs(z - np.polyval(p, y))
        use = residual <= 4 * 1.4826 * np.median(residual[use]) + 1e-9
    low, high = float(y[use].min()), float(y[use].max())
    top = float(np.clip(-p[1] / (2 * p[0]), low, high)) if p[0] < 0 else (low if p[1] < 0 else high)
    return float(np.polyval(p, top))


def sections(points: np.ndarray) -> Section:
    """Of every profile in which the wall is seen, by x."""
    rows = []
    at = np.arange(-HALF, HALF, ACROSS) + 0.5 * ACROSS
    for profile in points:
        p = profile[np.isfinite(profile).all(axis=1)]
        p = p[np.argsort(p[:, 1])]
        near, beside = (
            np.abs(p[:, 1]) <= CROWN,
            (np.abs(p[:, 1]) >= STRIP[0]) & (np.abs(p[:, 1]) <= STRIP[1]),
        )
        if near.sum() < 8 or beside.sum() < 20:
            continue
        base = float(np.median(p[beside, 2]))
        top = crown(p[near, 1] / CROWN, p[near, 2])
        h = np.maximum(np.interp(at, p[:, 1], p[:, 2]) - base, 0.0)
        over = at[h > 0.5 * (top - base)]
        if top - base < 8e-4 or not over.size:
            continue
        rows.append(
            (
                np.median(p[:, 0]),
                top - base,
                h.sum() * ACROSS,
                over[-1] - over[0] + ACROSS,
                over.mean(),
            )
        )
    return Section(*np.array(sorted(rows)).T)


def figures(scans: list[np.ndarray]) -> dict[str, float]:
    """Of the scans before the wall and after its layers: SI, without the ends, means of the layers."""
    found = [sections(s) for s in scans[1:]]
    low = max(float(s.x[s.top > 0.5 * np.median(s.top)].min()) for s in found) + ENDS
    high = min(float(s.x[s.top > 0.5 * np.median(s.top)].max()) for s in found) - ENDS
    grid = np.arange(low, high, ROW)
    rows = []
    for s in found:
        top, area, middle = (np.interp(grid, s.x, v) for v in (s.top, s.area, s.middle))
        wide, rel = np.median(np.interp(grid, s.x, s.width)), level(grid, area).std() / area.mean()
        spread = (level(grid, top).std(), rel, wide, level(grid, middle).std())
        rows.append((top, *spread, correlation_length(level(grid, top))))
    tops, *of_layers = zip(*rows, strict=True)
    growth = [b - a for a, b in zip(tops[:-1], tops[1:], strict=True)]
    names = ('top_rms', 'section', 'width', 'middle', 'correlation_length')
    out = {name: float(np.mean(v)) for name, v in zip(names, of_layers, strict=True)}
    out['growth'] = float(np.mean([level(grid, g).std() / g.mean() for g in growth]))
    return out | plate(scans[0])


def level(x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Without its straight line."""
    return v - np.polyval(np.polyfit(x, v, 1), x)


def correlation_length(v: np.ndarray) -> float:
    """m, at which the autocorrelation of values ROW apart falls to 1/e."""
    d = v - v.mean()
    r = np.array([np.sum(d[: d.size - k] * d[k:]) for k in range(d.size // 2)]) / np.sum(d * d)
    below = np.flatnonzero(r < np.exp(-1))
    if not below.size:
        return ROW * r.size
    k = int(below[0])
    return float(ROW * (k - 1 + (r[k - 1] - np.exp(-1)) / (r[k - 1] - r[k])))


def plate(points: np.ndarray) -> dict[str, float]:
    """Of the scan before the wall: noise from point to point and about a line within 15 mm of its axis, m; share of
    points of whole profiles that are lost."""
    step, rest = [], []
    for profile in points:
        p = profile[np.isfinite(profile).all(axis=1) & (np.abs(profile[:, 1]) < NEAR)]
        if len(p) > 50:
            p = p[np.argsort(p[:, 1])]
            step.append(1.4826 * np.median(np.abs(np.diff(p[:, 2]))) / np.sqrt(2))
            rest.append(1.4826 * np.median(np.abs(level(p[:, 1], p[:, 2]))))
    lost = 1.0 - float(np.isfinite(points).all(axis=-1).mean())
    return {
        'scan_noise_step': float(np.mean(step)),
        'scan_noise': float(np.mean(rest)),
        'scan_lost': lost,
    }
