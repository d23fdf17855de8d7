"""How far pose errors of a robot bend the map that its scanner measures: predicted from stated errors, before any scan.

The scanner is placed by the joint states. Where the arm is off, the profile lies beside its place: the height z by the
error of z, and on slopes by those of x and y. Work zero and scanner are taught at one place, so what counts is how much
the error changes from there. The errors are those of `waam_robot.uncertain.Stated`; each is propagated by itself, their
squares are added. Backlash is left out: within a scan line it does not change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .station import Reach
from .uncertain import Stated


@dataclass(frozen=True)
class Bend:
    """rms: m, root mean square of the height error over the places; largest: m, its standard deviation at the worst
    place; place: (3,) m, there, machine coordinates."""

    rms: float
    largest: float
    place: np.ndarray

    @property
    def text(self) -> str:
        """One line for people."""
        x, y, z = self.place * 1e3
        return (
            f'pose errors bend a measured map by {self.rms * 1e3:.3f} mm (RMS), {self.largest * 1e3:.3f} mm at '
            f'({x:.0f}, {y:.0f}, {z:.0f}) mm of the machine, by the stated errors of the robot'
        )


def bend(
    station: Reach,
    tips: np.ndarray,
    taught: np.ndarray,
    scanner: np.ndarray,
    stated: Stated | None = None,
) -> Bend:
    """tips: (N, 3) m, torch positions of scans, machine coordinates; taught: (3,) m; scanner: (3,) m, what is measured
    as the torch sees it, such as 60 mm beside it and on its level."""
    joints = station.joints(np.vstack([taught, tips]))
    slopes = station.slopes(joints, scanner, stated or Stated())
    change = slopes[1:] - slopes[:1]
    each = np.sqrt((change**2).sum(axis=1))
    worst = int(np.argmax(each))
    return Bend(float(np.sqrt(np.mean(each**2))), float(each[worst]), np.asarray(tips[worst]))
