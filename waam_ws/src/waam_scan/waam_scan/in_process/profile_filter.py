"""Which points of a profile beside the burning arc belong to the surface: not glare, spatter or smoke.

A surface is continuous along a profile and changes little from one profile to the next; what the arc adds is neither.
Every profile is cut where neighbouring points jump. A piece is kept when most of its points lie where the profiles
before showed the surface; where these have shown nothing for some time, when it is long enough to be one. All is
causal. Profiles must come in their order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

BIN = 0.25e-3  # m of the lateral axis that share one remembered height
GAP = 0.6e-3  # m across, between points of one surface
STEP = 0.3e-3  # m up or down, between neighbouring points of one surface
SMOOTHING = 0.5  # weight of the newest profile in the remembered height


@dataclass(frozen=True)
class ProfileLimits:
    """What is believed of profiles beside the arc."""

    gate: float = 1.0e-3  # m between a point and the height that the profiles before showed there
    least: int = 12  # points of a piece that can be a surface where nothing is remembered
    lost: int = 12  # profiles without a kept point after which a remembered height is forgotten
    # m, lateral reach of the scanner to each side
    reach: float = 0.1


class ProfileFilter:
    """`keep` profile by profile, or `block` for many. `kept` and `refused` count points."""

    def __init__(self, limits: ProfileLimits | None = None) -> None:
        self.limits = limits or ProfileLimits()
        self.kept = self.refused = 0
        size = 2 * int(np.ceil(self.limits.reach / BIN)) + 1
        self._height = np.zeros(size)  # remembered, m
        self._age = np.full(size, np.iinfo(np.int32).max // 2, np.int32)  # profiles since then

    def block(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """z (n, m) m of profiles with lateral coordinates x (n, m) m; a copy with NaN where a point is refused."""
        out = np.array(z, copy=True)
        for row, (xs, zs) in enumerate(zip(x, z, strict=True)):
            out[row, ~self.keep(xs, zs)] = np.nan
        return out

    def keep(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        """(m,) bool, the points of the next profile x, z (m,) m that are believed; NaN never is."""
        limits, keep = self.limits, np.zeros(len(x), bool)
        good = np.flatnonzero(np.isfinite(x) & np.isfinite(z) & (np.abs(x) < limits.reach))
        self._age += 1
        if not good.size:
            return keep
        a, b = x[good].astype(float), z[good].astype(float)
        if (np.diff(a) < 0).any():
            order = np.argsort(a, kind='stable')
            good, a, b = good[order], a[order], b[order]
        place = np.rint(a / BIN).astype(np.int32) + len(self._height) // 2
        ok = np.zeros(len(a), np.bool_)
        _judge(
            x=a, z=b, place=place, height=self._height, age=self._age, gate=limits.gate, least=limits.least,
            lost=limits.lost, ok=ok,
        )  # fmt: skip
        keep[good[ok]] = True
        self.kept += int(ok.sum())
        self.refused += int(len(ok) - ok.sum())
        return keep


@numba.njit(cache=True, nogil=True)
def _judge(
    x: np.ndarray,
    z: np.ndarray,
    place: np.ndarray,
    height: np.ndarray,
    age: np.ndarray,
    gate: float,
    least: int,
    lost: int,
    ok: np.ndarray,
) -> None:
    """Sets ok (n,) of points x, z (n,) in the order of x; place (n,): of each in the remembered height and age.
    Remembers the points that are believed."""
    n, first = len(x), 0
    for i in range(1, n + 1):
        if i < n and abs(z[i] - z[i - 1]) <= STEP and x[i] - x[i - 1] <= GAP:
            continue
        told = agree = 0
        for j in range(first, i):
            if age[place[j]] <= lost:
                told += 1
                agree += abs(z[j] - height[place[j]]) <= gate
        length = i - first
        # nothing remembered there: a piece that is long enough; otherwise most of what is remembered must agree
        if 2 * agree > told if 2 * told > length else length >= least:
            for j in range(first, i):
                p = place[j]
                ok[j] = age[p] > lost or abs(z[j] - height[p]) <= gate
        first = i
    first = 0
    while first < n:
        p, total, count = place[first], 0.0, 0
        while first < n and place[first] == p:
            if ok[first]:
                total += z[first]
                count += 1
            first += 1
        if count:
            mean = total / count
            height[p] = mean if age[p] > lost else height[p] + SMOOTHING * (mean - height[p])
            age[p] = 0


def warm_up() -> None:
    """Compiles the loop (or loads it), so that the first profile beside an arc does not wait for it."""
    ProfileFilter().keep(np.zeros(2), np.zeros(2))
