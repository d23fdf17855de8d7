"""Retention: which jobs give up their telemetry and maps. Their reports, layers, beads and anomalies stay. Pure."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime, timedelta

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
    """older_than: jobs of this age and more; max_bytes: then the oldest, until all together take no more."""

    older_than: timedelta | None = None
    max_bytes: int | None = None


def chosen(held: list[Held], policy: Policy, now: datetime) -> list[Held]:
    """Jobs that give up their arrays, oldest first. Never one without a report, and never one of unknown age."""
    able = [h for h in held if h.has_report and h.bytes and h.created is not None]
    able.sort(key=lambda h: (h.created or now, h.job))
    total = sum(h.bytes for h in held)
    found = []
    for h in able:
        old = policy.older_than is not None and now - (h.created or now) >= policy.older_than
        large = policy.max_bytes is not None and total > policy.max_bytes
        if old or large:
            found.append(h)
            total -= h.bytes
    return found


def size(asked: str) -> int:
    """'20G', '500 MB' as bytes (powers of ten). ValueError."""
    found = _SIZE.fullmatch(asked.strip())
    if found is None:
        raise ValueError(f"'{asked}' is no size: wanted a number with K, M, G or T, such as 20G")
    return int(float(found.group(1)) * _FACTOR[found.group(2).upper()])
