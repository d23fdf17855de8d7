"""Random worn parts as repair shops get them, to train on: sharp pockets and slots, chipped corners, rounded edges,
pits, pads, walls, rims, bands, on level, sloping and curved faces. In mm; none of them is a part that is reported."""

from __future__ import annotations

import numpy as np

from .parts import Shape, _all, _box, _disc, _rectangle, _soft, _waves

FACES = {'face': 0.3, 'slot': 0.12, 'pocket': 0.14, 'pits': 0.12, 'edge': 0.18, 'corner': 0.14}
BODIES = {'block': 0.4, 'pad': 0.2, 'rib': 0.14, 'rim': 0.14, 'band': 0.12}


def random_repair(rng: np.random.Generator) -> Shape:
    """A body of BODIES whose face is worn in one or two ways of FACES, by 1.7 to 8 mm."""
    while True:
        shape = _drawn(rng)
        if shape.worn is not None and (shape.nominal - shape.worn)[1:, 1:][shape.kept].max() > 1.7:
            return shape  # otherwise what is worn lies beside the body


def _drawn(rng: np.random.Generator) -> Shape:
    body = str(rng.choice(list(BODIES), p=list(BODIES.values())))
    if body == 'rim':
        return _rim(rng)
    length, width = rng.uniform(36, 90), rng.uniform(26, 58)
    plan, x, y = _rectangle(length, width)
    u, v = x - length / 2, y - width / 2
    nominal, within = 22.0 + _ground(rng, u, v), np.full(x.shape, np.inf)
    if body == 'pad':
        a, b = rng.uniform(9, 0.42 * length), rng.uniform(7, 0.42 * width)
        within = _box(u, v, a, b, rng.uniform(0.5, min(a, b)))
    elif body == 'rib':
        within = _box(u, v, 0.44 * length, rng.uniform(3.5, 7), rng.uniform(0.5, 3))
    elif body == 'band':
        wave = rng.uniform(2, 6) * np.sin(x / rng.uniform(9, 18))
        keep = np.abs(v - wave) < rng.uniform(5, 0.4 * width)
        kept = keep[:-1, :-1] & keep[1:, :-1] & keep[1:, 1:] & keep[:-1, 1:]
        wear = _worn(rng, 'edge' if rng.random() < 0.5 else 'face', u, v - wave, length, width)
        return Shape(plan, kept, nominal, nominal - wear)
    raised = np.isfinite(within)
    nominal = np.where(raised & (within < 0), nominal - rng.uniform(5, 12), nominal)
    ways = ['face'] if raised.any() else list(rng.choice(list(FACES), 1, p=list(FACES.values())))
    if rng.random() < 0.3:
        ways.append(str(rng.choice(['edge', 'corner', 'pits'])))
    wear = np.max([_worn(rng, way, u, v, length, width) for way in ways], axis=0)
    return Shape(plan, _all(plan), nominal, nominal - np.where(within > 0, wear, 0.0))


def _rim(rng: np.random.Generator) -> Shape:
    """A ring 6 to 15 mm wide, worn round about, on one side, or along its outer edge."""
    inner = rng.uniform(6, 24)
    outer = inner + rng.uniform(6, 15)
    plan, turn = _disc(inner, outer)
    edge = np.linspace(outer - inner, 0, len(turn))[:, None]
    wear = rng.uniform(2, 4.5) * (1 + rng.uniform(0, 0.4) * np.cos(turn - rng.uniform(0, 6)))
    wear = wear + rng.uniform(0, 0.25) * np.sin(rng.integers(2, 6) * turn)
    if rng.random() < 0.35:
        wear = wear * _soft(rng.uniform(7, 14) - edge, rng.uniform(3, 9))
    return Shape(plan, _all(plan), np.full(turn.shape, 20.0), 20.0 - wear)


def _ground(rng: np.random.Generator, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Level, sloping by up to 14 degrees, or curved across."""
    kind = rng.random()
    if kind < 0.5:
        return np.zeros(u.shape)
    if kind < 0.8:
        turn, rise = rng.uniform(0, 2 * np.pi), np.tan(np.radians(rng.uniform(3, 14)))
        return rise * (u * np.cos(turn) + v * np.sin(turn))
    return -((v - rng.uniform(-8, 8)) ** 2) / rng.uniform(110, 400)


def _worn(
    rng: np.random.Generator, way: str, u: np.ndarray, v: np.ndarray, length: float, width: float
) -> np.ndarray:
    """What is missing. u, v: about the middle of a rectangle of these sides."""
    depth, a, b = rng.uniform(1.8, 5), length / 2, width / 2
    rough = _waves(rng, u, v, rng.uniform(0.05, 0.3))
    if way == 'face':
        tilt = rng.uniform(-0.3, 0.3) * u / a + rng.uniform(-0.3, 0.3) * v / b
        return depth * (1 + tilt) + rough
    if way == 'slot':
        d = _box(u, v - rng.uniform(-4, 4), rng.uniform(0.4, 0.9) * a, rng.uniform(4, 8), 1.0)
        broken = rng.uniform(0, 1) * _soft(d + 2.2, 2.2)
        return depth * np.clip(d + 0.5, 0, 1) + broken
    if way == 'pocket':
        d = _box(u, v, rng.uniform(0.35, 0.8) * a, rng.uniform(0.4, 0.8) * b, rng.uniform(1, 9))
        return (depth + rough) * _soft(d, rng.uniform(1, 8))
    if way == 'pits':
        pits = [np.zeros(u.shape)]
        for _ in range(rng.integers(1, 5)):
            size = rng.uniform(5, 11)
            p, q = u - rng.uniform(-0.7, 0.7) * a, v - rng.uniform(-0.6, 0.6) * b
            oval = 1 + 0.15 * np.sin(3 * np.arctan2(q, p) + rng.uniform(0, 6))
            shape = _soft(size * oval - np.hypot(p, q), rng.uniform(0.35, 0.8) * size)
            pits.append(rng.uniform(1.5, 5) * shape)
        return np.max(pits, axis=0)
    if way == 'edge':
        reach, turn = rng.uniform(8, 16), rng.random() < 0.5
        d = reach - ((u + a) if turn else (v + b))
        return (depth + rough) * _soft(d, rng.uniform(0.3, 1.0) * reach)
    slope = rng.uniform(0.5, 1.4)
    d = (rng.uniform(16, 30) - (u + a) - slope * (v + b)) / np.hypot(1, slope)
    steep = rng.uniform(0.15, 0.45)
    return np.clip(steep * d, 0, 6) + (0.3 * depth + rough) * _soft(d, rng.uniform(2, 4))
