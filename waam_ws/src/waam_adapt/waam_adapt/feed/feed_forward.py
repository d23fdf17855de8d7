"""Setpoints of planned segments: speed from psi (eq 2.23), wire feed from the mass balance (eq
2.17), heat and flow factor.

The wanted height is allotted once. The base feed lays the planned height at the programmed speed;
the correction asks for height/(1 + k_gain*psi) + residual_height in its place. Speed takes the
first term and the feed takes what remains at the speed that is really driven, so neither undoes the
other, also when the speed is limited. All arrays have length n, one entry per segment; SI.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_process.bead import wire_feed
from waam_process.grid import GridSpec, HeightGrid
from waam_process.materials import Material
from waam_process.segment import Clamp, Kind
from waam_process.units import to_m_min

SATURATED = 1.0 - 1e-6
WEIGHTS = np.array([0.25, 0.5, 0.25])  # start, middle, end of a segment


class SetpointError(ValueError):
    """A segment or factor that no setpoint can be computed from; the text names segment, field and
    limit.
    """


@dataclass(frozen=True)
class Path:
    """n planned segments as arrays."""

    index: np.ndarray  # (n,) number in the job, for messages
    kind: np.ndarray  # (n,) numbers of `Kind`
    start: np.ndarray  # (n, 3) m, work frame
    end: np.ndarray  # (n, 3) m
    height: np.ndarray  # (n,) m, planned layer height
    width: np.ndarray  # (n,) m, bead width
    speed: np.ndarray  # (n,) m/s, programmed

    def check(self) -> None:
        """SetpointError names the first segment and field that cannot be used."""
        deposit = self.kind == Kind.DEPOSIT
        self._refuse(~np.isin(self.kind, list(Kind)), 'kind', self.kind, 'is not known')
        for name in ('start', 'end'):
            a = getattr(self, name)
            self._refuse(~np.isfinite(a).all(axis=1), name, a, 'is not finite')
        for name in ('height', 'width', 'speed'):
            a = getattr(self, name)
            self._refuse(~np.isfinite(a), name, a, 'is not finite')
        for name, low, high in (
            ('height', 1e-5, 0.02),
            ('width', 1e-4, 0.05),
            ('speed', 1e-5, 1.0),
        ):
            a = getattr(self, name)
            self._refuse(deposit & ~((a >= low) & (a <= high)), name, a, f'must be {low} .. {high}')

    def _refuse(self, bad: np.ndarray, name: str, values: np.ndarray, why: str) -> None:
        if bad.any():
            i = int(np.argmax(bad))
            raise SetpointError(f'segment {self.index[i]}: {name} is {values[i]}, {why}')


@dataclass(frozen=True)
class Limits:
    """The narrower of material and machine, SI."""

    speed: tuple[float, float]
    feed: tuple[float, float]
    voltage: tuple[float, float]

    @classmethod
    def of(
        cls, material: Material, speed: tuple[float, float], feed: tuple[float, float]
    ) -> Limits:
        """speed, feed: (low, high) of the machine in m/s. SetpointError when they exclude those of the material."""

        def both(a: tuple[float, float], b: tuple[float, float], what: str) -> tuple[float, float]:
            low, high = max(a[0], b[0]), min(a[1], b[1])
            if low > high:
                raise SetpointError(
                    f'{what} limits of material {a} and machine {b} (SI) exclude each other'
                )
            return low, high

        m = material
        return cls(
            both((m.speed_min, m.speed_max), speed, 'speed'),
            both((m.feed_min, m.feed_max), feed, 'wire feed'),
            (m.voltage_min, m.voltage_max),
        )


@dataclass(frozen=True)
class Field:
    """The correction map as feed_forward needs it: psi and residual_height (m) on one grid."""

    spec: GridSpec
    psi: np.ndarray
    residual_height: np.ndarray
    k_gain: float
    flow_factor: float = 1.0
    width_ratio: float = 0.0  # measured over expected bead width; 0 = the voltage stays as planned

    def __post_init__(self) -> None:
        if not (self.width_ratio == 0 or 0.3 <= self.width_ratio <= 3.0):
            raise SetpointError(
                f'correction: width_ratio is {self.width_ratio}, must be 0 or 0.3 .. 3'
            )
        if not np.isfinite(self.psi).all() or np.abs(self.psi).max() > 1 + 1e-6:
            raise SetpointError('correction: psi must be finite and inside -1 .. 1')
        if not np.isfinite(self.residual_height).all() or np.abs(self.residual_height).max() > 0.02:
            raise SetpointError('correction: residual_height must be finite and within 0.02 m')
        for name, low, high in (('k_gain', 0.0, 0.9), ('flow_factor', 0.5, 2.0)):
            if not low <= getattr(self, name) <= high:
                raise SetpointError(
                    f'correction: {name} is {getattr(self, name)}, must be {low} .. {high}'
                )


@dataclass(frozen=True)
class Setpoints:
    """Per segment; the terms as in waam_msgs/Segment. Only those with `deposit` are to be written
    back.
    """

    deposit: np.ndarray
    speed: np.ndarray
    wire_feed_speed: np.ndarray
    voltage: np.ndarray
    wire_feed_base: np.ndarray
    psi: np.ndarray
    residual_height: np.ndarray
    k_gain: float
    heat_factor: float
    flow_factor: float
    clamps: np.ndarray

    def explain(self, i: int) -> str:
        """Where the wire feed of segment i comes from, as a product that can be checked by hand."""
        base = self.wire_feed_base[i]
        rest = self.wire_feed_speed[i] / (base * self.heat_factor * self.flow_factor)
        bits = [(b.name or '').lower() for b in Clamp if b and int(self.clamps[i]) & int(b)]
        return (
            f'feed {to_m_min(self.wire_feed_speed[i]):.3f} m/min = {to_m_min(base):.3f} (eq 2.17 from plan) '
            f'x {rest:.4f} (height and speed: psi {self.psi[i]:+.3f}, k_gain {self.k_gain:.2f}, '
            f'residual {self.residual_height[i] * 1e3:+.3f} mm) x {self.heat_factor:.4f} (heat) '
            f'x {self.flow_factor:.4f} (flow); '
            f'speed {self.speed[i] * 1e3:.2f} mm/s; limited: {", ".join(bits) or "nothing"}'
        )

    def count(self, bits: Clamp) -> int:
        """Segments of which any of these bits is set."""
        return int(np.count_nonzero(self.clamps & int(bits)))


def sample(field: Field, path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """psi and residual_height (m) of every segment, means over start, middle and end; and whether
    psi was saturated there.

    Outside the map both are 0.
    """
    x, y = (
        np.stack(
            [path.start[:, i], 0.5 * (path.start[:, i] + path.end[:, i]), path.end[:, i]], axis=1
        )
        for i in (0, 1)
    )
    psi, residual = (
        np.nan_to_num(HeightGrid(field.spec, m).sample(x, y))
        for m in (field.psi, field.residual_height)
    )
    return psi @ WEIGHTS, residual @ WEIGHTS, np.abs(psi).max(axis=1) >= SATURATED


def compute(
    path: Path,
    material: Material,
    limits: Limits,
    voltage: np.ndarray | float,
    correction: Field | None = None,
    apply: bool = True,
    heat_factor: float = 1.0,
) -> Setpoints:
    """Setpoints of all segments; those that deposit nothing keep theirs (see `Setpoints.deposit`).

    Without `apply` (open loop, monitor) psi and residual are recorded but speed stays programmed
    and flow_factor 1. When the feed meets a limit, an applied correction lets the speed make up for
    the metal inside its own limits. The lag of the wire is the controller's business.
    """
    if not 0.1 <= heat_factor <= 1.0:
        raise SetpointError(f'heat_factor is {heat_factor}, must be 0.1 .. 1')
    path.check()
    deposit, none = path.kind == Kind.DEPOSIT, np.zeros(len(path.kind))
    psi, residual, saturated = none, none, none > 0
    k_gain, flow = 0.0, 1.0
    if correction is not None:
        psi, residual, saturated = sample(correction, path)
        k_gain, flow = correction.k_gain, correction.flow_factor if apply else 1.0
    apply = apply and correction is not None
    factor = 1 + k_gain * psi if apply else none + 1
    height = np.where(deposit, path.height, 1.0)
    base = wire_feed(path.width, height, path.speed, material)
    wanted = np.maximum(1 / factor + (residual / height if apply else 0.0), 0.0)
    metal = base * wanted * heat_factor * flow
    speed, feed, clamps = _speed_and_feed(path.speed, factor, metal, limits, make_up=apply)
    planned_voltage = none + voltage
    if apply and correction is not None and correction.width_ratio > 0:
        planned_voltage[deposit] = width_voltage(
            path, speed, feed, material, correction.width_ratio
        )
    volts, bits = _clamp(planned_voltage, limits.voltage, Clamp.VOLTAGE, Clamp.VOLTAGE)
    clamps = np.where(deposit, clamps | bits | np.where(saturated, int(Clamp.PSI), 0), 0)
    return Setpoints(
        deposit=deposit,
        speed=speed,
        wire_feed_speed=feed,
        voltage=volts,
        wire_feed_base=base,
        psi=psi,
        residual_height=residual,
        k_gain=k_gain,
        heat_factor=heat_factor,
        flow_factor=flow,
        clamps=clamps,
    )


def width_voltage(
    path: Path, speed: np.ndarray, feed: np.ndarray, material: Material, width_ratio: float
) -> float:
    """Voltage of a layer, V, limits aside: by eq 2.13 its beads have the planned width on average.

    speed, feed: (n,) m/s that will be driven. One voltage for the layer: within it speed and wire belong to the height.
    """
    laid = path.kind == Kind.DEPOSIT
    if not laid.any():
        return material.voltage
    length = np.linalg.norm(path.end - path.start, axis=1)[laid]

    def mean(values: np.ndarray) -> float:
        return float(np.average(values[laid], weights=length + 1e-12))

    return material.voltage_for(mean(path.width) / width_ratio, mean(feed), mean(speed))


def _speed_and_feed(
    programmed: np.ndarray, factor: np.ndarray, metal: np.ndarray, limits: Limits, make_up: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Speed and feed inside their limits, and clamp bits; metal: feed that lays it at programmed speed.

    The feed follows the speed that is really driven; with `make_up` the speed follows a limited feed.
    """
    speed, bits = _clamp(programmed * factor, limits.speed, Clamp.SPEED_LOW, Clamp.SPEED_HIGH)
    wanted = metal * speed / np.where(programmed > 0, programmed, 1.0)
    feed, feed_bits = _clamp(wanted, limits.feed, Clamp.FEED_LOW, Clamp.FEED_HIGH)
    bits |= feed_bits
    if make_up:
        other = np.where(feed == wanted, speed, speed * feed / np.maximum(wanted, 1e-9))
        speed, speed_bits = _clamp(other, limits.speed, Clamp.SPEED_LOW, Clamp.SPEED_HIGH)
        bits |= speed_bits
    return speed, feed, bits


def _clamp(
    values: np.ndarray, limits: tuple[float, float], low: Clamp, high: Clamp
) -> tuple[np.ndarray, np.ndarray]:
    """Limited values, and the bits of what was limited."""
    tolerance = 1e-9 * limits[1]
    below, above = values < limits[0] - tolerance, values > limits[1] + tolerance
    return np.clip(values, *limits), np.where(below, int(low), 0) | np.where(above, int(high), 0)
