"""Who gets which messages: the file notify.yaml. Pure. No error text ever holds an address: they contain passwords."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import yaml

from .events import KINDS
from .rate import Limits

HIDDEN = '(hidden)'
MAX_ADDRESS_LENGTH = 2000  # letters of an address
KEYS = ('targets', 'per_hour', 'repeat_s', 'wire_m')
EXAMPLE = """\
# Addresses of apprise (https://github.com/caronc/apprise): mail, chat, webhook. They hold passwords: chmod 600.
targets:
  - name: shift                      # as messages of the program call it
    url: mailtos://user:password@mail.example.com?to=shift@example.com
    events: [paused, alarm, low_wire] # of done, paused, alarm, out_of_tolerance, low_wire; default: all
per_hour: 20     # messages at most
repeat_s: 600    # the same event of the same job or alarm at most once in so long
wire_m: 20       # low_wire: less wire than this on the spool
"""


class NotifyError(ValueError):
    """The settings are wrong; the text says where, without any address."""


@dataclass(frozen=True)
class Target:
    """url: a secret; it stays out of repr, too."""

    name: str
    url: str = field(repr=False)
    events: tuple[str, ...] = KINDS


@dataclass(frozen=True)
class NotifySettings:
    """wire_m: m of wire on the spool below which people are told."""

    targets: tuple[Target, ...] = ()
    limits: Limits = Limits()
    wire_m: float = 20.0


def parse(text: str) -> NotifySettings:
    """The settings from the text of notify.yaml. Raises NotifyError."""
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as e:
        mark = getattr(e, 'problem_mark', None)
        where = f'line {mark.line + 1}: ' if mark else ''
        raise NotifyError(f'{where}not YAML') from None
    except (ValueError, RecursionError, MemoryError):
        raise NotifyError('not YAML') from None
    if data is None:
        return NotifySettings()
    if not isinstance(data, dict):
        raise NotifyError(f'must have the keys {", ".join(KEYS)}')
    _known(data, KEYS, 'notify.yaml')
    rows = data.get('targets') or []
    if not isinstance(rows, list):
        raise NotifyError('targets: a list is wanted')
    targets = tuple(_target(n, row) for n, row in enumerate(rows, 1))
    if len({t.name for t in targets}) != len(targets):
        raise NotifyError('two targets have the same name')
    limits = Limits(
        int(_number(data, 'per_hour', 20, 1, 1000)), _number(data, 'repeat_s', 600, 0, 86400)
    )
    return NotifySettings(targets, limits, _number(data, 'wire_m', 20, 0, 1e5))


def without_secrets(text: str, targets: tuple[Target, ...]) -> str:
    """Takes the addresses of the targets, and every part of them that could be a secret, out of a text."""
    for target in targets:
        for part in sorted({target.url, *_parts(target.url)}, key=len, reverse=True):
            text = text.replace(part, HIDDEN)
    return text


def _parts(url: str) -> list[str]:
    rest = url.partition('://')[2]
    for separator in '/@?&=:':
        rest = rest.replace(separator, ' ')
    return [p for p in rest.split() if len(p) >= 6]


def _known(data: dict[Any, Any], keys: tuple[str, ...], where: str) -> None:
    # an unknown key may be half an address: only plain words are repeated
    unknown = [str(k) if str(k).isidentifier() else HIDDEN for k in data if k not in keys]
    if unknown:
        raise NotifyError(f'{where}: unknown key {unknown[0][:30]}; known are {", ".join(keys)}')


def _target(number: int, row: Any) -> Target:
    where = f'target {number}'
    if not isinstance(row, dict):
        raise NotifyError(f'{where}: name, url and events are wanted')
    _known(row, ('name', 'url', 'events'), where)
    name, url, events = row.get('name'), row.get('url'), row.get('events', list(KINDS))
    if not isinstance(name, str) or not name or len(name) > 40 or not name.isprintable():
        raise NotifyError(f'{where}: name must be a short text')
    if not isinstance(url, str) or '://' not in url or len(url) > MAX_ADDRESS_LENGTH:
        raise NotifyError(f'{where}: url must be an address of apprise, such as mailtos://...')
    if not isinstance(events, list) or not events or not all(e in KINDS for e in events):
        raise NotifyError(f'{where}: events must be some of {", ".join(KINDS)}')
    return Target(name, url, tuple(events))


def _number(data: dict[str, Any], name: str, default: float, low: float, high: float) -> float:
    value = data.get(name, default)
    good = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not good or not low <= value <= high:
        raise NotifyError(f'{name} must be a number from {low:g} to {high:g}')
    return float(value)
