"""What a command left out of its recordings because it was bad: each by name, with the reason, and the count."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field

NAMED = 12  # lines or profiles of one file that are named; of more the count and the last one


class NothingLeft(ValueError):
    """All that was given had to be left out; the text names it."""


@dataclass(frozen=True)
class Item:
    """One thing that is not used. kind: 'scan', 'profile' or 'block'; place: 'profile 17', or '' = all of it."""

    kind: str
    file: str
    place: str
    reason: str

    def __str__(self) -> str:
        return f'{self.file}{", " * bool(self.place)}{self.place}: {self.reason}'


@dataclass
class LeftOut:
    """Collects; `lines` tells all of it."""

    items: list[Item] = field(default_factory=list)

    def add(self, kind: str, file: object, place: str, reason: object) -> None:
        """reason: text or error; the file's name at its beginning is not said twice."""
        name, text = str(file), str(reason)
        for start in (f'{name}, {place}' if place else name, name):
            if text.startswith(start):
                text = text.removeprefix(start).lstrip(',: ')
        self.items.append(Item(kind, name, place, text))

    def __bool__(self) -> bool:
        return bool(self.items)

    def lines(self) -> list[str]:
        """One note each, and the count at the end; of a file with many bad lines the first ones by name."""
        told: Counter[tuple[str, str]] = Counter()
        shown, last = [], {}
        for item in self.items:
            key = item.file, item.kind
            told[key] += 1
            last[key] = item
            if told[key] <= NAMED:
                shown.append(f'left out: {item}')
        for key, count in told.items():
            if count > NAMED:
                more = f'{count - NAMED} more of its {key[1]}s, the last one {last[key].place}'
                shown.append(f'left out: {key[0]}: {more} ({last[key].reason})')
        return [*shown, f'{self.count()} left out; the rest is used'] if shown else []

    def count(self) -> str:
        """'3 profiles, 1 scan'."""
        kinds = Counter(i.kind for i in self.items)
        return ', '.join(f'{n} {kind}{"s" * (n > 1)}' for kind, n in sorted(kinds.items()))

    def nothing_left(self, where: object) -> NothingLeft:
        """The error of a command for which nothing remains."""
        if len(self.items) == 1:
            return NothingLeft(str(self.items[0]))
        few = '; '.join(str(i) for i in self.items[:3])
        more = f'; and {len(self.items) - 3} more' if len(self.items) > 3 else ''
        return NothingLeft(f'{where}: nothing is left ({self.count()} left out): {few}{more}')


def leave_out(
    left_out: LeftOut | None, kind: str, file: object, place: str, error: Exception
) -> None:
    """Into left_out, as of `LeftOut.add`; where nobody collects it is the error."""
    if left_out is None:
        raise error
    left_out.add(kind, file, place, error)


def tell(left_out: LeftOut) -> None:
    """What was left out, on stderr."""
    for line in left_out.lines():
        print(f'note: {line}', file=sys.stderr)
