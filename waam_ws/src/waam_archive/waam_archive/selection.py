"""Which jobs are meant: filters as SQL with bound parameters. Nothing that a person typed becomes SQL text. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

TEXTS = ('job', 'part', 'material', 'wire_lot', 'operator', 'verdict', 'loop_mode', 'cell', 'state')
NONE = '-'  # a filter of this value finds the jobs that have none


class SelectionError(ValueError):
    """A filter that means nothing; the text says which."""


@dataclass(frozen=True)
class Selection:
    """Filters; those that are empty do not count. Texts take * and ? as wildcards and do not mind case; '-' finds jobs
    without a value. since, until: UTC."""

    job: str = ''
    part: str = ''
    material: str = ''
    wire_lot: str = ''
    operator: str = ''
    verdict: str = ''
    loop_mode: str = ''
    cell: str = ''
    state: str = ''
    since: datetime | None = None
    until: datetime | None = None

    def where(self) -> tuple[str, list[Any]]:
        """Condition on the columns of `jobs`, and its parameters."""
        terms = ['true']
        values: list[Any] = []
        for name in TEXTS:
            asked = getattr(self, name)
            if asked == NONE:
                terms.append(f'jobs."{name}" IS NULL')
            elif asked:
                terms.append(f'lower(jobs."{name}") GLOB ?')
                values.append(_pattern(asked))
        for sign, moment in (('>=', self.since), ('<', self.until)):
            if moment is not None:
                terms.append(f'jobs.created {sign} ?')
                values.append(moment)
        return ' AND '.join(terms), values


def _pattern(asked: str) -> str:
    """For GLOB: square brackets have no meaning of their own."""
    return asked.lower().replace('[', '[[]')


def moment(asked: str, now: datetime) -> datetime:
    """'2026-11-21', '2026-11-21T09:30', or an age such as '30d', '12h'. SelectionError. now: UTC, without a zone."""
    units = {'h': 'hours', 'd': 'days', 'w': 'weeks'}
    try:
        if asked[-1:] in units and asked[:-1].replace('.', '', 1).isdigit():
            return now - timedelta(**{units[asked[-1]]: float(asked[:-1])})
        found = datetime.fromisoformat(asked)
        return found.astimezone(UTC).replace(tzinfo=None) if found.tzinfo else found
    except (ValueError, OverflowError):
        raise SelectionError(
            f"'{asked}' is no time: wanted 2026-11-21, 2026-11-21T09:30, or an age such as 30d or 12h"
        ) from None
