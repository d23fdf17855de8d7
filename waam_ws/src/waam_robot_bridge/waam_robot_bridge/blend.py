"""Corners of a commanded path as a robot can take them at the programmed speed. Pure.

The controller core passes a corner on the given path and slows down there. A robot with the axes' lag compensated would
have to jump in speed. Between two straight legs the path is therefore replaced: it swings a little wide before the
corner, turns, and swings back. The curve has the length that the programmed speed covers in the time that the core
takes for that stretch. So the speed stays what it was, and the robot stays in step with the core, its arc and its wire.
Elsewhere the path is averaged over a few ms, which takes out the steps of the core.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.integrate import trapezoid

LEG = 60  # ms on both sides of a place by which its turn is measured
SMOOTH = 12  # ms to both sides of the average, where the drives need no more (`limits.smoothing`)
MIN_TURN, MAX_TURN = np.radians(12.0), np.radians(125.0)  # turns that are replaced
STRAIGHT = 8e-6  # m: a leg leaves its line by less than this
LEVEL = 2e-5  # m: and its height too
SPEED_OFF = 0.05  # both legs are as fast as each other but for this share
SLOWEST = 1e-3  # m/s
USUAL = 1.03  # length of a curve over that of its legs: what the core's slowing down adds
MIN_LEG = 0.3e-3  # m: of a leg
MAX_LEG_MS = 80  # ms of a leg: a goal shows whole corners before the robot comes to them
GRID = np.linspace(-1.0, 1.0, 201)
HIGHEST = 4.0  # rad: the greatest swing that is looked for


@dataclass(frozen=True)
class Corner:
    """at: ms of the place in the path; place: (2,) m; before, after: (2,) unit vectors; turn: rad."""

    at: int
    place: np.ndarray
    before: np.ndarray
    after: np.ndarray
    turn: float


def blended(tips: np.ndarray, tolerance: float, smooth: int = SMOOTH) -> np.ndarray:
    """(n, 3) m: torch positions of every ms for those that the core commands, (n, 3); the path between is left by at
    most `tolerance` (m) at corners; 0 = corners are only averaged, over `smooth` ms to both sides as everything."""
    even = averaged(tips, smooth)
    if tolerance <= 0 or len(tips) < 4 * LEG:
        return even
    out = even.copy()
    for corner in corners(tips):
        _replace(out, even, corner, tolerance)
    return out


def averaged(tips: np.ndarray, smooth: int = SMOOTH) -> np.ndarray:
    """(n, 3): weighted mean of (n, 3) over `smooth` ms to both sides; straight and even stretches stay."""
    weight = np.concatenate([np.arange(1, smooth + 2), np.arange(smooth, 0, -1)]).astype(float)
    weight /= weight.sum()
    padded = np.pad(tips - tips[-1], ((smooth, smooth), (0, 0)), 'edge')
    columns = [np.convolve(padded[:, n], weight, 'valid') for n in range(tips.shape[1])]
    return np.column_stack(columns) + tips[-1]


def corners(tips: np.ndarray) -> list[Corner]:
    """Places of (n, 3) where two straight, level legs of LEG ms meet at an angle between MIN_TURN and MAX_TURN."""
    flat = tips[:, :2]
    back, ahead = flat[LEG:-LEG] - flat[: -2 * LEG], flat[2 * LEG :] - flat[LEG:-LEG]
    cross = back[:, 0] * ahead[:, 1] - back[:, 1] * ahead[:, 0]
    turn = np.abs(np.arctan2(cross, np.einsum('ij,ij->i', back, ahead)))
    turn[np.minimum(np.hypot(*back.T), np.hypot(*ahead.T)) < SLOWEST * LEG * 1e-3] = 0.0
    found: list[Corner] = []
    while turn.max(initial=0.0) > MIN_TURN:
        n = int(np.argmax(turn))
        made = _corner(tips, n + LEG)
        if made is not None:
            found.append(made)
        turn[max(n - LEG, 0) : n + LEG + 1] = 0.0
    return sorted(found, key=lambda c: c.at)


def _corner(tips: np.ndarray, at: int) -> Corner | None:
    """The corner near ms `at`, None where its legs are not straight, not level, or turn too far."""
    gap = SMOOTH // 2
    first, second = tips[at - LEG : at - gap], tips[at + gap : at + LEG + 1]
    if np.ptp(tips[at - LEG : at + LEG + 1, 2]) > LEVEL:
        return None
    a, b = _line(first[:, :2]), _line(second[:, :2])
    if a is None or b is None:
        return None
    turn = float(np.arccos(np.clip(a[1] @ b[1], -1, 1)))
    if not MIN_TURN < turn < MAX_TURN:
        return None
    along = np.linalg.solve(np.column_stack([a[1], -b[1]]), b[0] - a[0])
    return Corner(at, a[0] + along[0] * a[1], a[1], b[1], turn)


def _line(points: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """(a point, the unit direction of travel) of the line through (n, 2); None where they do not lie on one."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    way = axes[0] * np.sign(axes[0] @ (points[-1] - points[0]))
    off = np.abs((points - middle) @ axes[1]).max()
    return (middle, way) if off < STRAIGHT else None


def _replace(out: np.ndarray, path: np.ndarray, corner: Corner, tolerance: float) -> None:
    """Puts the curve around `corner` into `out` (n, 3) in place of `path` (n, 3); leaves it where that does not fit."""
    usual = _speed(path, corner.at - 2 * LEG, corner.at - LEG)
    half = min(tolerance / shape(round(corner.turn, 3), USUAL)[1], MAX_LEG_MS * usual)
    begin = _passes(path, corner, corner.before, -half)
    end = _passes(path, corner, corner.after, half)
    if begin is None or end is None or half < MIN_LEG:
        return
    speeds = [_speed(path, begin - LEG, begin), _speed(path, end, end + LEG)]
    speed = float(np.mean(speeds))
    if speed < SLOWEST * 1e-3 or np.ptp(speeds) > SPEED_OFF * speed:
        return
    ratio = speed * (end - begin) / (2 * half)
    if not 0.99 < ratio < 1.3:
        return
    swing, _ = shape(round(corner.turn, 3), round(max(ratio, 1.0), 4))
    ms = np.arange(int(np.ceil(begin)), int(np.floor(end)) + 1)
    along = curve(corner.turn, swing, 2 * (ms - begin) / (end - begin) - 1)
    ahead = corner.before + corner.after
    ahead /= np.linalg.norm(ahead)
    side = np.array([-ahead[1], ahead[0]])
    side *= np.sign(corner.after @ side)
    start, size = corner.place - half * corner.before, 2 * half * np.cos(corner.turn / 2)
    out[ms, :2] = start + size * (along[:, :1] * ahead + along[:, 1:] * side)


def _passes(path: np.ndarray, corner: Corner, way: np.ndarray, at: float) -> float | None:
    """ms, with a fraction, when `path` passes the place `at` (m) beyond the corner along `way`; None: not near it."""
    low, high = max(corner.at - 4 * LEG, 0), min(corner.at + 4 * LEG, len(path))
    side = slice(low, corner.at + 1) if at < 0 else slice(corner.at, high)
    along = (path[side, :2] - corner.place) @ way
    off = np.linalg.norm(path[side, :2] - corner.place - along[:, None] * way, axis=1)
    inside = np.flatnonzero((along[:-1] <= at) & (along[1:] > at))
    if not len(inside):
        return None
    n = int(inside[-1] if at < 0 else inside[0])
    between = slice(n, None) if at < 0 else slice(0, n + 1)
    if off[between][np.abs(along[between]) > MIN_LEG].max(initial=0.0) > STRAIGHT:
        return None
    return float(side.start + n + (at - along[n]) / (along[n + 1] - along[n]))


def _speed(path: np.ndarray, begin: float, end: float) -> float:
    """m/ms, mean from ms `begin` to `end`; 0 beyond the path."""
    first, last = int(round(begin)), int(round(end))
    if first < 0 or last >= len(path):
        return 0.0
    return float(np.linalg.norm(path[last, :2] - path[first, :2]) / (last - first))


# ---- the curve


def _heading(turn: float, swing: float, u: np.ndarray) -> np.ndarray:
    """rad against the chord, u from -1 to 1: from -turn/2 to turn/2, over-swinging by `swing`, even at the ends."""
    return np.asarray(turn * (3 * u - u**3) / 4 + swing * u * (1 - u**2) ** 2)


@lru_cache(4096)
def shape(turn: float, ratio: float) -> tuple[float, float]:
    """(swing, deviation over the length of a leg) of the curve whose length is `ratio` of that of both legs."""
    wanted = np.cos(turn / 2) / ratio
    low, high = -turn, HIGHEST
    for _ in range(50):
        middle = (low + high) / 2
        mean = trapezoid(np.cos(_heading(turn, middle, GRID)), GRID) / 2
        low, high = (middle, high) if mean > wanted else (low, middle)
    points = curve(turn, low, GRID) * 2 * np.cos(turn / 2)  # in legs
    out = np.array([np.cos(turn / 2), -np.sin(turn / 2)])
    back = np.array([np.cos(turn / 2), np.sin(turn / 2)])
    first = _from_leg(points, np.zeros(2), out)
    second = _from_leg(points - out, np.zeros(2), back)
    return low, float(np.minimum(first, second).max())


def _from_leg(points: np.ndarray, start: np.ndarray, way: np.ndarray) -> np.ndarray:
    """(n,): distance of (n, 2) from a leg of length 1."""
    along = np.clip((points - start) @ way, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - along[:, None] * way, axis=1))


def curve(turn: float, swing: float, u: np.ndarray) -> np.ndarray:
    """(n, 2): places along and across the chord at u (-1 ... 1), in lengths of the chord, passed at an even speed."""
    fine = np.linspace(-1.0, 1.0, 801)
    heading = _heading(turn, swing, fine)
    steps = np.column_stack([np.cos(heading), np.sin(heading)])
    way = np.concatenate([np.zeros((1, 2)), np.cumsum((steps[1:] + steps[:-1]) / 2, axis=0)])
    way /= way[-1, 0]
    return np.column_stack([np.interp(u, fine, way[:, n]) for n in range(2)])
