"""Pictures of the calibrations of a robot. PNG bytes."""

from __future__ import annotations

import numpy as np

from .pictures import figure_of, png
from .robot_fit import HandEye, Tool


def touches(found: Tool) -> bytes:
    """How far the tip misses the point in every pose, and the intervals of the tip."""
    figure = figure_of(3.6)
    left, right = figure.subplots(1, 2, width_ratios=(2, 1))
    left.bar(np.arange(1, len(found.misses) + 1), 1e3 * found.misses, color='0.5')
    left.set(xlabel='touch', ylabel='mm', title='tip from the point, by the angles as told')
    right.errorbar(range(3), np.zeros(3), 1e3 * found.interval, fmt='o', capsize=6)
    right.set_xticks(
        range(3), [f'{a}\n{v:.2f}' for a, v in zip('xyz', 1e3 * found.tip, strict=True)]
    )
    right.set(ylabel='mm', xlim=(-0.5, 2.5), title='tip, 95 % intervals')
    return png(figure)


def profiles(found: HandEye) -> bytes:
    """The profiles about the centre of the sphere, and how far their points are off it."""
    figure = figure_of(4.4)
    left = figure.add_subplot(1, 2, 1, projection='3d')
    at = 1e3 * (found.points - found.centre)
    left.scatter(*at.T, c=found.of, s=2, cmap='tab20')
    left.set(xlabel='x, mm', ylabel='y, mm', zlabel='z, mm', title='profiles on the sphere')
    left.set_aspect('equal')
    right = figure.add_subplot(1, 2, 2)
    right.plot(found.of + 1, 1e3 * found.misses, '.', ms=3, color='0.4')
    right.set(xlabel='pose', ylabel='mm', title='off the sphere, by the angles as told')
    return png(figure)
