"""Picture of a corrected program on axes that are neither square nor to scale."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from waam_plan.post.skew import AxisErrors, SkewError
from waam_plan.post.skew_program import points_of


def draw(before: str, after: str, errors: AxisErrors, path: Path | str) -> None:
    """Picture: where the machine goes with the program as it was and with the corrected one; errors magnified."""
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    wanted = points_of(before)
    if not len(wanted):
        raise SkewError('the program has no moves to draw')
    real = {
        'as it was': wanted @ errors.axes.T,
        'corrected': points_of(after)[: len(wanted)] @ errors.axes.T,
    }
    worst = max(float(np.abs(v - wanted).max()) for v in real.values())
    size = float(np.ptp(wanted[:, :2], axis=0).max()) or 1.0
    factor = max(1.0, 0.08 * size / worst) if worst > 0 else 1.0
    figure, axis = plt.subplots(figsize=(8, 6.5), dpi=110)
    axis.plot(wanted[:, 0], wanted[:, 1], color='0.75', lw=3, label='wanted')
    for (name, points), colour in zip(real.items(), ('#c0392b', '#1f7a3d'), strict=True):
        shown = wanted + factor * (points - wanted)
        error = float(np.linalg.norm(points - wanted, axis=1).max())
        axis.plot(
            shown[:, 0],
            shown[:, 1],
            color=colour,
            lw=1,
            label=f'{name}: largest error {error:.4f} mm',
        )
    axis.set_aspect('equal')
    axis.set(
        xlabel='x, mm',
        ylabel='y, mm',
        title=f'Program on the calibrated axes, errors x {factor:.0f}',
    )
    axis.legend(loc='upper center', bbox_to_anchor=(0.5, -0.1), ncol=3, frameon=False)
    figure.savefig(path, bbox_inches='tight')
    plt.close(figure)
