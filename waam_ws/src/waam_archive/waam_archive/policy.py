"""Retention: which jobs give up their telemetry and maps. Their reports, layers, beads and anomalies stay. Pure."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime, timedelta

_AGE = re.compile(r'(\d+(?:\.\d+)?)\s*([hdw])')
_UNIT = {'h': 'hours', 'd': 'days', 'w': 'weeks'}
_SIZE = re.compile(r'(\d+(?:\.\d+)?)\s*([KMGT]?)B?', re.IGNORECASE)
_FACTOR = {'': 1, 'K': 1e3, 'M': 1e6, 'G': 1e9, 'T': 1e12}


@dataclass(frozen=True)
class Held:
    """A job with what its telemetry and maps take. created: UTC, None = not known."""

    job: str
    created: datetime | None
    bytes: int
    has_report: bool


@dataclass(frozen=True)
class Policy:
    """As people write it and as it is kept: '180d', '50G'; '' = no limit of that kind. older_than: jobs of this age and
    more; max_size: then the oldest, until all together take no more. ValueError names what means nothing."""

    older_than: str = ''
    max_size: str = ''

    def __post_init__(self) -> None:
        if not all(isinstance(v, str) for v in (self.older_than, self.max_size)):
            raise ValueError('older_than and max_size are texts such as 180d and 50G')
        _ = self.age, self.max_bytes

    def __bool__(self) -> bool:
        return bool(self.older_than or self.max_size)

    def __str__(self) -> str:
        said = []
        if self.older_than:
            said.append(f'jobs older than {self.older_than}')
        if self.max_size:
            said.append(f'the oldest until all arrays take no more than {self.max_size}')
        return ', then '.join(said) or 'none'

    @property
    def age(self) -> timedelta | None:
        """None: no limit."""
        return age(self.older_than) if self.older_than else None

    @property
    def max_bytes(self) -> int | None:
        """None: no limit."""
        return size(self.max_size) if self.max_size else None


@dataclass(frozen=True)
class Decision:
    """What a policy means for an archive. gone: jobs that give up their arrays, oldest first. spared: jobs that have
    arrays and keep them whatever the policy says, for they have no report or no time. left: bytes of all arrays that
    stay; over: how many of them are more than the policy allows."""

    gone: list[Held]
    spared: list[Held]
    left: int
    over: int

    @property
    def bytes(self) -> int:
        """That the jobs give up."""
        return sum(h.bytes for h in self.gone)


def decide(held: list[Held], policy: Policy, now: datetime) -> Decision:
    """now: UTC, without a zone. Never a job without a report, and never one of unknown age."""
    able = [h for h in held if h.has_report and h.bytes and h.created is not None]
    able.sort(key=lambda h: (h.created or now, h.job))
    spared = [h for h in held if h.bytes and not (h.has_report and h.created is not None)]
    left, limit = sum(h.bytes for h in held), policy.max_bytes
    gone = []
    for h in able:
        old = policy.age is not None and now - (h.created or now) >= policy.age
        if old or (limit is not None and left > limit):
            gone.append(h)
            left -= h.bytes
    return Decision(gone, spared, left, max(0, left - (limit or left)))


def age(asked: str) -> timedelta:
    """'180d', '12h', '26w'. ValueError: a date is none, for a policy that is kept must mean the same tomorrow."""
    found = _AGE.fullmatch(asked.strip())
    try:
        if found is not None:
            return timedelta(**{_UNIT[found.group(2)]: float(found.group(1))})
    except OverflowError:
        pass
    raise ValueError(f"'{asked}' is no age: wanted hours, days or weeks, such as 12h, 180d or 26w")


def size(asked: str) -> int:
    """'20G', '500 MB' as bytes (powers of ten). ValueError."""
    found = _SIZE.fullmatch(asked.strip())
    if found is None:
        raise ValueError(f"'{asked}' is no size: wanted a number with K, M, G or T, such as 20G")
    return int(float(found.group(1)) * _FACTOR[found.group(2).upper()])
