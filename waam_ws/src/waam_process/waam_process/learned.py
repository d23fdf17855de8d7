"""What the jobs of one cell have taught about its process, kept from job to job, for one material and regime.

What is kept is how much of the wire becomes height in the first layer; everything else a job finds out as fast by
itself. `after` merges one more job; every figure stays inside of `LIMITS`.

Files are JSON with their own SHA-256. Pure: reading and writing is done by who calls.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

VERSION = 2
# Fields of version 1 that nothing is made of any more; such files are read without them.
OF_VERSION_1 = ('layer_noise', 'lag', 'ends', 'network_weight', 'network')
KIND = 'waam learned'
# Of one job about the next, with the same wire and with another lot: standard deviations of the efficiency.
DRIFT, OTHER_LOT = 0.015, 0.04
FORGETTING = 0.7  # of what former jobs weigh, per job; other lot: a third of it
OTHER_LOT_FORGETTING = 0.25
MAX_SIGMAS = 3.0  # a job further off counts as this far
MIN_SIGMA = 5e-3
MAX_JOBS = 1_000_000
MAX_TEXT_LENGTH = 200  # characters of a text
MAX_BYTES = 65536

LIMITS: dict[str, tuple[float, float]] = {
    'efficiency': (0.7, 1.3),
    'efficiency_sigma': (MIN_SIGMA, 0.3),
    'weight': (0.0, 1.0 / (1.0 - FORGETTING) + 1e-9),
}


class LearnedError(ValueError):
    """A text that is no `Learned`; the message names the field and the limit."""


@dataclass(frozen=True)
class Taught:
    """What one job has shown. Units as in `Learned`."""

    efficiency: float
    efficiency_sigma: float
    layers: int


@dataclass(frozen=True)
class Learned:
    """What the jobs so far have shown."""

    cell: str  # which cell, material and regime it belongs to
    material: str
    regime: str
    jobs: int  # that it was learned from
    layers: int  # of all of them
    efficiency: float  # measured growth over what the material table expects
    efficiency_sigma: float  # its standard uncertainty, at the end of the last job
    weight: float  # of the jobs so far, in jobs: the newest one counts 1/weight
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
        """With the job that started with this (`for_job`), by a scalar Kalman filter. What lies beyond `LIMITS` counts
        as the limit."""
        prior, noise = self.efficiency_sigma**2, max(taught.efficiency_sigma, MIN_SIGMA) ** 2
        most = MAX_SIGMAS * math.sqrt(prior + noise)
        gain = prior / (prior + noise)
        step = min(max(_limited('efficiency', taught.efficiency) - self.efficiency, -most), most)
        return replace(
            self,
            jobs=min(self.jobs + 1, MAX_JOBS),
            layers=min(self.layers + taught.layers, MAX_JOBS),
            efficiency=_limited('efficiency', self.efficiency + gain * step),
            efficiency_sigma=_limited('efficiency_sigma', math.sqrt((1 - gain) * prior)),
            weight=_limited('weight', self.weight + 1.0),
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
        efficiency=1.0, efficiency_sigma=0.15, weight=0.0, wire_lot='', last_job='',
    )  # fmt: skip


def plain(text: str) -> str:
    """What of a text may stand in a file."""
    return ''.join(c for c in text if c.isprintable())[:MAX_TEXT_LENGTH]


def regime_of(bead_width: float, layer_height: float) -> str:
    """Name of a regime, fit for a file: bead width and thickest layer (m) in hundredths of a millimetre."""
    return f'w{bead_width * 1e5:.0f}_h{layer_height * 1e5:.0f}'


def parse(text: str) -> Learned:
    """LearnedError names what is wrong: no JSON, another version, a field that is missing, unknown, of the wrong type
    or out of range, or a hash that does not fit."""
    if len(text) > MAX_BYTES:
        raise LearnedError(f'{len(text)} characters long, must be {MAX_BYTES} at most')
    try:
        data = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError, MemoryError) as e:
        raise LearnedError(f'not JSON ({e})') from None
    if not isinstance(data, dict) or data.get('kind') != KIND:
        raise LearnedError(f"not a file of what jobs have taught (kind is not '{KIND}')")
    if data.get('version') not in (1, VERSION):
        raise LearnedError(
            f'version is {data.get("version")!r}, this software reads 1 and {VERSION}'
        )
    own = data.pop('sha256', None)
    hashed = _sha256(data)
    dropped = OF_VERSION_1 if data['version'] == 1 else ()
    values = {k: v for k, v in data.items() if k not in ('kind', 'version', *dropped)}
    known = {f.name: f.type for f in fields(Learned)}
    for name in known:
        if name not in values:
            raise LearnedError(f"'{name}' is missing")
    for name in values:
        if name not in known:
            raise LearnedError(f"unknown field '{name}'")
    found = Learned(**{name: _checked(name, str(known[name]), v) for name, v in values.items()})
    if own != hashed:
        raise LearnedError('sha256 does not fit the content: the file is torn or was changed')
    return found


def _checked(name: str, kind: str, value: Any) -> Any:
    if kind == 'str':
        if not isinstance(value, str) or len(value) > MAX_TEXT_LENGTH or not value.isprintable():
            raise LearnedError(
                f'{name} must be a printable text of {MAX_TEXT_LENGTH} characters at most'
            )
        return value
    if kind == 'int':
        if type(value) is not int or not 0 <= value <= MAX_JOBS:
            raise LearnedError(f'{name} is {_short(value)}, must be a whole number 0 .. {MAX_JOBS}')
        return value
    return _number(name, value)


def _number(name: str, value: Any) -> float:
    low, high = LIMITS[name]
    if type(value) not in (int, float) or not low <= value <= high:
        raise LearnedError(f'{name} is {_short(value)}, must be a number {low:g} .. {high:g}')
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
