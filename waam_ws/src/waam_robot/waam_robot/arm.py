"""Six-axis arms by their Denavit-Hartenberg table (S3, table 3.1), and where their links are.

Angles are those of the table ("DH": theta2 = 0 is horizontal) in rad, lengths in m. `waam_robot.joints` has the angles
that a pendant shows.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .frames import translation

AXES = 6
QUARTER = np.pi / 2
PATTERN = (QUARTER, 0.0, QUARTER, -QUARTER, QUARTER, 0.0)  # alpha of an arm with a spherical wrist
MM, DEG = 1e-3, np.pi / 180


class ArmError(ValueError):
    """The description of an arm cannot be used; the text names what and why."""


@dataclass(frozen=True)
class Link:
    """One row of the table: d and a in m, alpha in rad."""

    d: float = 0.0
    a: float = 0.0
    alpha: float = 0.0


@dataclass(frozen=True)
class Arm:
    """links: six rows; tool: (4, 4) flange to wire tip; low, high: limits of the DH angles, rad;
    forearm: limits of theta2 + theta3, the forearm against the horizontal upright, rad; name: for messages.

    Joints 2 and 3 of arms like this one are coupled: their drives hold the forearm against the base, so its range
    is one of theta2 + theta3. ArmError for values that no arm has.
    """

    links: tuple[Link, ...]
    tool: np.ndarray = field(default_factory=lambda: np.eye(4))
    low: tuple[float, ...] = (-np.pi,) * AXES
    high: tuple[float, ...] = (np.pi,) * AXES
    forearm: tuple[float, float] = (-np.inf, np.inf)
    name: str = 'arm'

    def __post_init__(self) -> None:
        if len(self.links) != AXES or len(self.low) != AXES or len(self.high) != AXES:
            raise ArmError(f'{self.name}: an arm has {AXES} links and limits for each')
        numbers = [v for link in self.links for v in (link.d, link.a, link.alpha)]
        if not np.isfinite([*numbers, *self.low, *self.high, *np.ravel(self.tool)]).all():
            raise ArmError(f'{self.name}: a length, angle or limit is not a finite number')
        for n, (low, high) in enumerate(zip(self.low, self.high, strict=True), 1):
            if low >= high:
                raise ArmError(f'{self.name}: limits of joint {n} are {low:.4f} to {high:.4f} rad')


def forward(arm: Arm, theta: np.ndarray, tool: bool = True) -> np.ndarray:
    """(..., 4, 4): the wire tip (tool) or the flange in the base frame, for DH angles (..., 6)."""
    theta = np.asarray(theta, float)
    pose = step(arm.links[0], theta[..., 0])
    for n in range(1, AXES):
        pose = pose @ step(arm.links[n], theta[..., n])
    return pose @ arm.tool if tool else pose


def link_frames(arm: Arm, theta: np.ndarray) -> np.ndarray:
    """(..., 7, 4, 4): base and the frames at the ends of the six links, without tool."""
    theta = np.asarray(theta, float)
    frames = [np.broadcast_to(np.eye(4), (*theta.shape[:-1], 4, 4))]
    for n in range(AXES):
        frames.append(frames[-1] @ step(arm.links[n], theta[..., n]))
    return np.stack(frames, axis=-3)


def step(link: Link, theta: np.ndarray) -> np.ndarray:
    """(..., 4, 4): Rz(theta) Tz(d) Tx(a) Rx(alpha), S3 section 3.1.1."""
    c, s = np.cos(theta), np.sin(theta)
    ca, sa = np.cos(link.alpha), np.sin(link.alpha)
    out = np.zeros((*np.shape(theta), 4, 4))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2], out[..., 0, 3] = c, -ca * s, sa * s, link.a * c
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2], out[..., 1, 3] = s, ca * c, -sa * c, link.a * s
    out[..., 2, 1], out[..., 2, 2], out[..., 2, 3] = sa, ca, link.d
    out[..., 3, 3] = 1.0
    return out


def in_limits(arm: Arm, theta: np.ndarray) -> np.ndarray:
    """(...,) bool: DH angles (..., 6) as they stand, without turns added."""
    theta = np.asarray(theta, float)
    inside = ((theta >= arm.low) & (theta <= arm.high)).all(axis=-1)
    forearm = theta[..., 1] + theta[..., 2]
    return inside & (forearm >= arm.forearm[0]) & (forearm <= arm.forearm[1])


def limit_text(arm: Arm, theta: np.ndarray) -> str:
    """What is beyond its limit, in degrees; empty where nothing is."""
    said = [
        f'theta{n} is {v / DEG:.1f} deg, its range {low / DEG:.1f} to {high / DEG:.1f}'
        for n, (v, low, high) in enumerate(zip(theta, arm.low, arm.high, strict=True), 1)
        if not low <= v <= high
    ]
    forearm, (low, high) = float(theta[1] + theta[2]), arm.forearm
    if not low <= forearm <= high:
        said.append(
            f'theta2 + theta3 is {forearm / DEG:.1f} deg, its range {low / DEG:.1f} to {high / DEG:.1f}'
        )
    return '; '.join(said)


# Fanuc M-20iB/25 of source 003: lengths by its table 3.1. It prints ranges of joints 1 and 2 only (figure 3.8); the
# others are ours, of the size usual for such arms: put those of your data sheet in their place.
M20IB25 = Arm(
    links=tuple(
        Link(d * MM, a * MM, alpha)
        for d, a, alpha in zip(
            (650, 0, 0, 865, 0, 100), (75, 905, 120, 0, 0, 0), PATTERN, strict=True
        )
    ),
    tool=translation(0.290, 0.0, 0.090),
    low=tuple(v * DEG for v in (-180, -45, -180, -200, -140, -270)),
    high=tuple(v * DEG for v in (180, 180, 180, 200, 140, 270)),
    forearm=(-100 * DEG, 280 * DEG),
    name='M-20iB/25',
)
