"""What the drives may do: speed, acceleration and jerk of every joint. Pure.

The controller core changes the torch's acceleration at once, and in a corner that it passes its velocity as well.
`blend` averages its path over T to both sides, with weights that rise to 1 / T in the middle. So a change of the
acceleration by 2 A becomes a jerk of 2 A / T at most, and a jump of the velocity by D an acceleration of D / T and a
jerk of D / T^2. `smoothing` is the T that keeps every joint within its limits all over the box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waam_node.params import ParameterError
from waam_robot.timing import Drives

TORCH = 0.5  # m/s^2, A: the core's acceleration (waam_firmware, core/machine/waam_config.c)
DEVIATION = 2e-5  # m, d: its junction deviation, which gives the speed v in a corner with an angle t between its legs:
# v^2 = A d s / (1 - s), s = sin(t / 2); the jump is D = 2 v cos(t / 2) < sqrt(8 A d)
JUMP = (8 * TORCH * DEVIATION) ** 0.5  # m/s
MIN_FILTER_MS, MAX_FILTER_MS = (
    12,
    40,
)  # ms, of T: less does not take out the steps of the core, more does not fit between corners
KINDS = (
    '{0} would have to turn at {1:.2f} times its fastest',
    '{0} would have to accelerate at {1:.2f} times its limit',
    '{0} would need {1:.2f} times its limit of jerk',
)


@dataclass(frozen=True)
class Limits(Drives):
    """Of a robot behind the controller core, which gives the acceleration of its torch."""

    torch: float = TORCH

    def shares(self, joints: np.ndarray, dt: float) -> np.ndarray:
        """(N, 3, n): shares of the limits that a motion (N, n), rad, every dt s, takes; N > 3. At its ends, where there
        are no differences, acceleration and jerk are those beside."""
        speed = np.gradient(joints, dt, axis=0)
        push = np.diff(joints, 2, axis=0) / dt**2
        jerk = np.diff(joints, 3, axis=0) / dt**3
        pads = ((push, (1, 1), self.acceleration), (jerk, (1, 2), self.jerk))
        rest = [np.pad(v, (width, (0, 0)), 'edge') / limit for v, width, limit in pads]
        return np.abs(np.stack([speed / self.speed, *rest], axis=1))

    def text(self, kind: int, axis: int, share: float) -> str:
        """What a share above 1 means; kind, axis: where it is in `shares`."""
        return KINDS[kind].format(self.names[axis], share)


def smoothing(gains: np.ndarray, limits: Limits) -> int:
    """ms: T of all paths in a box. gains: (n,) rad/m, `waam_robot.station.Reach.gains`.

    ParameterError where no T is long enough, or a joint cannot accelerate as the core does.
    """
    sharp = limits.jerk / np.maximum(gains, 1e-9)  # m/s^3 of the torch
    least = (TORCH + np.sqrt(TORCH**2 + JUMP * sharp)) / sharp  # 2 A / T + D / T^2 = sharp
    ms = max(MIN_FILTER_MS, int(np.ceil(1e3 * least.max())))
    if ms > MAX_FILTER_MS:
        longest = MAX_FILTER_MS * 1e-3
        _refuse('joint_jerk_max', int(least.argmax()), gains, 2 * TORCH / longest + JUMP / longest**2, limits.names,
                'rad/s^3')  # fmt: skip
    push = TORCH + JUMP / (ms * 1e-3)
    over = gains * push / limits.acceleration
    if over.max() > 1:
        _refuse('joint_acceleration_max', int(over.argmax()), gains, push, limits.names, 'rad/s^2')
    return ms


def _refuse(
    name: str, axis: int, gains: np.ndarray, torch: float, names: Sequence[str], unit: str
) -> None:
    raise ParameterError(
        f"parameter '{name}': for the torch to move as the controller wants it, {names[axis]} needs "
        f'{gains[axis] * torch:.3g} {unit} in this box'
    )


def of_axes(joints: np.ndarray, rates: np.ndarray, dt: float, lag: float) -> np.ndarray:
    """(2 N - 1, n) rad, every dt / 2: where axes are that go after a goal (N, n) by cubics between its points, with
    servos of the time constant `lag` (s). They are as far behind at first as at a steady acceleration."""
    wanted = np.empty((2 * len(joints) - 1, joints.shape[1]))
    wanted[::2] = joints
    wanted[1::2] = (joints[:-1] + joints[1:]) / 2 + dt / 8 * (rates[:-1] - rates[1:])
    if not lag:
        return wanted
    h = dt / 2
    keep = np.exp(-h / lag)
    mean = lag / h * (1 - keep)
    out = np.empty_like(wanted)
    out[0] = joints[0] - lag * rates[0] + lag**2 * (rates[1] - rates[0]) / dt
    for n in range(len(wanted) - 1):  # exact for lines between the points
        out[n + 1] = keep * out[n] + (mean - keep) * wanted[n] + (1 - mean) * wanted[n + 1]
    return out
