"""Results of calibrations: what one says, and what the last ones mean for a job. Pure."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import Any

from .shapers import TYPES

VERSION = 1
KINDS = {
    'resonance': ('x', 'y'), 'steps': ('x', 'y', 'z'), 'skew': ('',), 'tcp': ('',), 'wire': ('',), 'lead': ('',),
    'robot-tcp': ('',), 'hand-eye': ('',),
}  # fmt: skip
GONE = ('arc',)  # kinds of older versions: their results count no more
SETTING_ROUNDING = 6e-4  # by how much a setting may differ from what was told: it travels rounded
OLD = timedelta(days=365)
LARGEST_SCALE = 0.005  # real over commanded length less 1
STEPS = 'steps_per_mm_'  # settings of the controller, and the axis
ACCEL = 'max_accel_'  # the same, mm/s^2
MIN_ACCEL = 50.0  # mm/s^2 that the controller takes
LARGEST_TOOL = 1e-3  # m: tip or scanner of a robot from where its programs have it
LARGEST_TURN = math.radians(0.5)  # of the scanner
LARGEST_WIRE = 0.05  # counts per mm over those of the controller less 1


class ResultError(ValueError):
    """A stored result that cannot be used; the text says why."""


@dataclass(frozen=True)
class Result:
    """One calibration. values: what was found, units in the names; settings: what the controller is told, in order;
    refuses: why no job may run with what was found, '' = it may; text: the outcome in a line."""

    kind: str
    axis: str
    text: str
    values: dict[str, float]
    evidence: dict[str, float] = field(default_factory=dict)
    settings: list[tuple[str, float]] = field(default_factory=list)
    refuses: str = ''
    date: str = ''  # ISO 8601, UTC; put in when it is kept

    @property
    def name(self) -> str:
        """Such as 'steps_x', 'skew'."""
        return f'{self.kind}_{self.axis}' if self.axis else self.kind

    def of(self, now: datetime) -> Result:
        """The same with its date."""
        return replace(self, date=now.astimezone(UTC).isoformat(timespec='seconds'))

    @property
    def when(self) -> datetime:
        """UTC"""
        return datetime.fromisoformat(self.date)


def digest(data: dict[str, Any]) -> str:
    """sha256 of the content, whatever its order."""
    text = json.dumps({k: v for k, v in data.items() if k != 'sha256'}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def to_data(result: Result) -> dict[str, Any]:
    """What the file says, its hash included."""
    data = {'waam_calibration_result': VERSION, **asdict(result)}
    data['settings'] = [[n, float(v)] for n, v in result.settings]
    data['sha256'] = digest(data)
    return data


def from_data(data: Any) -> Result:
    """ResultError when it is none, or was changed."""
    if not isinstance(data, dict) or data.get('waam_calibration_result') != VERSION:
        raise ResultError(f'not a calibration result of version {VERSION}')
    try:
        if data.get('sha256') != digest(data):
            raise ResultError('was changed by hand (its hash does not fit); calibrate again')
        result = Result(
            kind=_text(data, 'kind'),
            axis=_text(data, 'axis'),
            date=_text(data, 'date'),
            text=_text(data, 'text'),
            values=_numbers(data['values']),
            evidence=_numbers(data['evidence']),
            settings=[(str(n), _number(v)) for n, v in data['settings']],
            refuses=_text(data, 'refuses'),
        )
        if result.when.tzinfo is None:
            raise ResultError(f"its date '{result.date}' has no time zone")
    except ResultError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as e:
        raise ResultError(f'field missing or wrong: {e}') from None
    if result.axis not in KINDS.get(result.kind, ()):
        raise ResultError(f"unknown calibration '{result.name}'")
    return result


def _text(data: dict[str, Any], name: str) -> str:
    if not isinstance(value := data[name], str):
        raise ResultError(f"field '{name}' is no text")
    return value


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ResultError(f'{value!r} is no number')
    return float(value)


def _numbers(values: Any) -> dict[str, float]:
    return {str(k): _number(v) for k, v in values.items()}


def newest(results: Iterable[Result]) -> dict[str, Result]:
    """The last result of each name."""
    found: dict[str, Result] = {}
    for result in sorted(results, key=lambda r: r.when):
        found[result.name] = result
    return found


def refusals(
    results: Iterable[Result],
    damaged: Iterable[str] = (),
    told: Mapping[str, float] | None = None,
) -> list[str]:
    """Why a job must not run, one reason each. damaged: what is wrong with files that cannot be read. told: settings
    that the controller has, None = not known. What was never calibrated refuses nothing."""
    found = [f'{text}' for text in damaged]
    last = newest(results)
    found += [f'{name}: {r.refuses}' for name, r in sorted(last.items()) if r.refuses]
    wrong = [(name, _off(r, told or {})) for name, r in sorted(last.items())]
    return found + [f'{name}: {reason}' for name, reason in wrong if reason]


def _off(result: Result, told: Mapping[str, float]) -> str:
    """Why lengths are wrong with the steps per mm of the controller; '' = they are right, or not known."""
    for name, value in result.settings:
        if name.startswith(STEPS) and abs(told.get(name, value) / value - 1) > LARGEST_SCALE:
            off = 100 * (told[name] / value - 1)
            text = f'the controller has {told[name]:g} steps/mm, {value:g} were found: {off:+.2f} %'
            return f'{text}, at most {100 * LARGEST_SCALE:g} % (waam calibrate apply)'
    return ''


def told_by(answer: str) -> dict[str, float]:
    """Settings by the names that set them, of what a controller tells as `name=value name=value ...` (`$L` of
    docs/link_protocol.md); what is neither a number nor a shaper is left out."""
    found: dict[str, float] = {}
    for word in answer.split():
        name, _, value = word.partition('=')
        with contextlib.suppress(ValueError):
            if name == 'shape':
                found |= _shapers(value)
            else:
                found[name] = float(value)
    return found


def _shapers(value: str) -> dict[str, float]:
    """Of `zvd:41.40:0.053,none`: X, Y. ValueError when it is none."""
    found: dict[str, float] = {}
    for axis, text in zip('xy', value.split(','), strict=True):
        kind, *numbers = text.split(':')
        found[f'shape_{axis}'] = float(1 + TYPES.index(kind)) if kind != 'none' else 0.0
        if numbers:
            hz, damping = map(float, numbers)
            found |= {f'shape_{axis}_hz': hz, f'shape_{axis}_damping': damping}
    return found


def missing(results: Iterable[Result], told: Mapping[str, float]) -> list[str]:
    """Settings of the last results that the controller does not have, one line each. told: those that it has."""
    return [
        f'{r.name}: {name} is {told[name]:g} in the controller, {value:g} was found (waam calibrate apply)'
        for _, r in sorted(newest(results).items())
        for name, value in dict(r.settings).items()  # the last of each name counts
        if name in told and abs(told[name] - value) > SETTING_ROUNDING
    ]


def table(
    results: Iterable[Result],
    damaged: Iterable[str],
    now: datetime,
    told: Mapping[str, float] | None = None,
) -> list[str]:
    """What `waam calibrate status` prints: every calibration, when, what, what the controller has not, and what a job
    will refuse. told: settings that the controller has, None = not known."""
    last = newest(results)
    lines = []
    for kind, axes in KINDS.items():
        for axis in axes:
            name = f'{kind}_{axis}' if axis else kind
            lines.append(f'{name:12s} {_line(last.get(name), now)}')
    reasons = refusals(last.values(), damaged, told)
    lines += ['', *missing(last.values(), told or {})]
    lines += [f'a job will refuse: {reason}' for reason in reasons]
    return lines if reasons else [*lines, 'a job will refuse nothing of this']


def _line(result: Result | None, now: datetime) -> str:
    if result is None:
        return 'not calibrated'
    old = ' (more than a year ago)' if now - result.when > OLD else ''
    return f'{result.when:%Y-%m-%d %H:%M}{old}  {result.text}'
