"""What the jobs of one cell have taught about its process, kept from job to job, for one material and regime.

Only figures that hold for any part of the regime are kept, never a map by place: how much of the wire becomes height
in the first layer, how layers scatter, how far the metal trails, what beads do near arc on and off, and how far a
growth network is believed. `after` merges one more job; every figure stays inside of `LIMITS`.

Files are JSON with their own SHA-256. Pure: reading and writing is done by who calls.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

VERSION = 1
KIND = 'waam learned'
# quarters of a bead width from arc on, and as many before arc off, that all beads are taken to lay alike
END_PIECES = 8
# Of one job about the next, with the same wire and with another lot: standard deviations of the efficiency.
DRIFT, OTHER_LOT = 0.015, 0.04
FORGETTING = 0.7  # of what former jobs weigh, per job; other lot: a third of it
OTHER_LOT_FORGETTING = 0.25
UNTRIED = 0.9  # weight of a growth network that no job has tried
MOST_SIGMAS = 3.0  # a job further off counts as this far
LEAST_SIGMA = 5e-3
MOST_JOBS = 1_000_000
LONGEST = 200  # characters of a text
MOST_BYTES = 65536

LIMITS: dict[str, tuple[float, float]] = {
    'efficiency': (0.7, 1.3),
    'efficiency_sigma': (LEAST_SIGMA, 0.3),
    'layer_noise': (5e-3, 0.1),
    'lag': (-0.5, 0.5),
    'ends': (-1.0, 1.0),
    'network_weight': (0.0, 1.0),
    'weight': (0.0, 1.0 / (1.0 - FORGETTING) + 1e-9),
}


class LearnedError(ValueError):
    """A text that is no `Learned`; the message names the field and the limit."""


@dataclass(frozen=True)
class Taught:
    """What one job has shown. None: it did not show it. Units as in `Learned`."""

    efficiency: float
    efficiency_sigma: float
    layers: int
    layer_noise: float | None = None
    lag: float | None = None
    ends: tuple[float, ...] | None = None
    network_weight: float | None = None
    network: str = ''


@dataclass(frozen=True)
class Learned:
    """What the jobs so far have shown; the efficiency is that of the first layer, the rest that of the last one."""

    cell: str  # which cell, material and regime it belongs to
    material: str
    regime: str
    jobs: int  # that it was learned from
    layers: int  # of all of them
    efficiency: float  # measured growth over what the material table expects
    efficiency_sigma: float  # its standard uncertainty, at the end of the last job
    weight: float  # of the jobs so far, in jobs: the newest one counts 1/weight
    layer_noise: float  # standard deviation of a layer's efficiency about that of the process
    lag: float  # of the metal along the travel, bead widths
    # (16,) share of the planned height that beads lack: quarters of a bead width after arc on, then before arc off,
    # the nearest one last
    ends: tuple[float, ...]
    network_weight: float  # 0..1, of the growth network
    network: str  # hash of that network, '' = none was used
    wire_lot: str  # of the last job, '' = nobody said
    last_job: str

    def other_lot(self, wire_lot: str) -> bool:
        """Whether the wire is known to be another one than that of the last job."""
        return bool(wire_lot and self.wire_lot and plain(wire_lot) != self.wire_lot)

    def for_job(self, wire_lot: str) -> Learned:
        """What a job starts with: less certain and of less weight than what was left, most of all for another lot of
        wire. A lot that nobody told ('') counts as the same one. Before the first job nothing changes but the lot."""
        wire_lot = plain(wire_lot)
        lot = wire_lot or self.wire_lot
        if not self.jobs:
            return replace(self, wire_lot=lot)
        other = self.other_lot(wire_lot)
        sigma = math.hypot(self.efficiency_sigma, OTHER_LOT if other else DRIFT)
        weight = (OTHER_LOT_FORGETTING if other else FORGETTING) * self.weight
        sigma = _limited('efficiency_sigma', sigma)
        return replace(self, efficiency_sigma=sigma, weight=weight, wire_lot=lot)

    def after(self, taught: Taught, job_id: str) -> Learned:
        """With the job that started with this (`for_job`). The efficiency by a scalar Kalman filter, the rest as a mean
        in which the jobs of before count `weight`. What lies beyond `LIMITS` counts as the limit."""
        prior, noise = self.efficiency_sigma**2, max(taught.efficiency_sigma, LEAST_SIGMA) ** 2
        most = MOST_SIGMAS * math.sqrt(prior + noise)
        gain = prior / (prior + noise)
        step = min(max(_limited('efficiency', taught.efficiency) - self.efficiency, -most), most)
        weight = self.weight + 1.0

        def mean(name: str, old: float, new: float | None) -> float:
            return (
                old if new is None else _limited(name, old + (_limited(name, new) - old) / weight)
            )

        new_ends = taught.ends or (None,) * len(self.ends)
        same = taught.network == self.network
        return replace(
            self,
            jobs=min(self.jobs + 1, MOST_JOBS),
            layers=min(self.layers + taught.layers, MOST_JOBS),
            efficiency=_limited('efficiency', self.efficiency + gain * step),
            efficiency_sigma=_limited('efficiency_sigma', math.sqrt((1 - gain) * prior)),
            weight=_limited('weight', weight),
            layer_noise=mean('layer_noise', self.layer_noise, taught.layer_noise),
            lag=mean('lag', self.lag, taught.lag),
            ends=tuple(mean('ends', a, b) for a, b in zip(self.ends, new_ends, strict=True)),
            network=taught.network,
            network_weight=mean(
                'network_weight',
                self.network_weight if same else UNTRIED,
                taught.network_weight,
            ),
            last_job=plain(job_id),
        )

    def text(self) -> str:
        """JSON with the hash over all fields; `parse` reads it."""
        data = {'kind': KIND, 'version': VERSION, **asdict(self)}
        return json.dumps({**data, 'sha256': _sha256(data)}, indent=1)

    @property
    def sha256(self) -> str:
        """Of the content."""
        return _sha256({'kind': KIND, 'version': VERSION, **asdict(self)})


def nothing(cell: str, material: str, regime: str) -> Learned:
    """Before the first job: what a wire and a cell are like of which nobody knows anything."""
    return Learned(
        cell=plain(cell), material=plain(material), regime=plain(regime), jobs=0, layers=0,
        efficiency=1.0, efficiency_sigma=0.15, weight=0.0, layer_noise=0.02, lag=0.0,
        ends=(0.0,) * (2 * END_PIECES), network_weight=UNTRIED, network='', wire_lot='', last_job='',
    )  # fmt: skip


def plain(text: str) -> str:
    """What of a text may stand in a file."""
    return ''.join(c for c in text if c.isprintable())[:LONGEST]


def regime_of(bead_width: float, layer_height: float) -> str:
    """Name of a regime, fit for a file: bead width and thickest layer (m) in hundredths of a millimetre."""
    return f'w{bead_width * 1e5:.0f}_h{layer_height * 1e5:.0f}'


def parse(text: str) -> Learned:
    """LearnedError names what is wrong: no JSON, another version, a field that is missing, unknown, of the wrong type
    or out of range, or a hash that does not fit."""
    if len(text) > MOST_BYTES:
        raise LearnedError(f'{len(text)} characters long, must be {MOST_BYTES} at most')
    try:
        data = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError, MemoryError) as e:
        raise LearnedError(f'not JSON ({e})') from None
    if not isinstance(data, dict) or data.get('kind') != KIND:
        raise LearnedError(f"not a file of what jobs have taught (kind is not '{KIND}')")
    if data.get('version') != VERSION:
        raise LearnedError(f'version is {data.get("version")!r}, this software reads {VERSION}')
    own = data.pop('sha256', None)
    values = {k: v for k, v in data.items() if k not in ('kind', 'version')}
    known = {f.name: f.type for f in fields(Learned)}
    for name in known:
        if name not in values:
            raise LearnedError(f"'{name}' is missing")
    for name in values:
        if name not in known:
            raise LearnedError(f"unknown field '{name}'")
    found = Learned(**{name: _checked(name, str(known[name]), v) for name, v in values.items()})
    if own != found.sha256:
        raise LearnedError('sha256 does not fit the content: the file is torn or was changed')
    return found


def _checked(name: str, kind: str, value: Any) -> Any:
    if kind == 'str':
        if not isinstance(value, str) or len(value) > LONGEST or not value.isprintable():
            raise LearnedError(f'{name} must be a printable text of {LONGEST} characters at most')
        return value
    if kind == 'int':
        if type(value) is not int or not 0 <= value <= MOST_JOBS:
            raise LearnedError(
                f'{name} is {_short(value)}, must be a whole number 0 .. {MOST_JOBS}'
            )
        return value
    if kind == 'float':
        return _number(name, name, value)
    if not isinstance(value, list) or len(value) != 2 * END_PIECES:
        raise LearnedError(f'{name} must be a list of {2 * END_PIECES} numbers')
    return tuple(_number(f'{name}[{i}]', name, v) for i, v in enumerate(value))


def _number(label: str, name: str, value: Any) -> float:
    low, high = LIMITS[name]
    if type(value) not in (int, float) or not low <= value <= high:
        raise LearnedError(f'{label} is {_short(value)}, must be a number {low:g} .. {high:g}')
    return float(value)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 40 else text[:36] + ' ...'


def _no_constant(name: str) -> Any:
    raise ValueError(f'{name} is no number')


def _limited(name: str, value: float) -> float:
    low, high = LIMITS[name]
    return min(max(value, low), high) if math.isfinite(value) else low


def _sha256(data: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()
