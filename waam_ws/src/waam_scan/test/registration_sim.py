"""Surfaces and scans of them for tests and benchmarks of the registration; nothing is shared with the estimator."""

from __future__ import annotations

import numpy as np

SIZE = 0.1  # m


def shaped(x, y):
    """A worn surface of 20 mm relief, m."""
    return 0.010 + 0.006 * np.sin(40 * x) * np.cos(55 * y) + 0.003 * np.sin(110 * x + 60 * y)


def flat(x, y):
    return np.zeros(np.broadcast(x, y).shape)


def beads(x, y, share, height=2e-3, pitch=6e-3):
    """New metal over the part of the field with y < share * SIZE: rounded beads with flanks and ripples."""
    edge = np.clip((share * SIZE - y) / 2e-3, 0, 1)
    inside = np.clip(np.minimum(x - 4e-3, SIZE - 4e-3 - x) / 2e-3, 0, 1)
    ripple = 1 + 0.08 * np.cos(2 * np.pi * y / pitch) + 0.03 * np.sin(900 * x)
    return height * np.sqrt(edge * inside) * ripple


def scan(
    surface, rng, points=200_000, noise=30e-6, spikes=0.01, dropouts=0.05, share=0.0
) -> np.ndarray:
    """(n, 3) m: profile lines across y at random phase, noise, spikes up to 5 mm and drop-outs."""
    lines = round(np.sqrt(points))
    u, v = np.meshgrid(
        (np.arange(lines) + rng.random()) / lines, (np.arange(lines) + rng.random()) / lines
    )
    x, y = u.ravel() * SIZE, v.ravel() * SIZE + rng.normal(0, 5e-6, u.size)
    z = surface(x, y) + (beads(x, y, share) if share else 0.0)
    z = z + noise * rng.standard_normal(len(x))
    wrong = rng.random(len(x)) < spikes
    z[wrong] += rng.uniform(-5e-3, 5e-3, int(wrong.sum()))
    return np.column_stack([x, y, z])[rng.random(len(x)) > dropouts]


def drift(rng, length=0.3e-3, angle=np.radians(0.1), about=(SIZE / 2, SIZE / 2, 0.01)):
    """(rotation (3, 3), translation (3,)): `length` in a random direction and `angle` about a random axis."""
    shift, axis = rng.normal(size=(2, 3))
    shift *= length / np.linalg.norm(shift)
    x, y, z = axis / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)
    about = np.array(about)
    return rotation, about + shift - rotation @ about


def error(
    result_rotation, result_translation, rotation, translation, at=(SIZE / 2, SIZE / 2, 0.01)
):
    """Errors of the motion of the middle of the field (3,) m and of the rotation (3,) rad, of undoing a drift.

    The drift moved the scan; the registration must be its inverse.
    """
    at = np.array(at)
    moved = rotation @ at + translation
    back = result_rotation @ moved + result_translation - at
    total = result_rotation @ rotation
    turn = 0.5 * np.array(
        [total[2, 1] - total[1, 2], total[0, 2] - total[2, 0], total[1, 0] - total[0, 1]]
    )
    return back, turn
