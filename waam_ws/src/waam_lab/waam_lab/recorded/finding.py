"""What a recording says about the cell: parameters with intervals, figures before and after, what it cannot tell."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

NINETY = 1.6449  # standard deviations that hold 90 % of a normal distribution to either side


@dataclass(frozen=True)
class Parameter:
    """One of the cell file. told: the recording decides it; otherwise the cell file leaves it as it was."""

    name: str
    value: float
    low: float
    high: float
    usual: float
    told: bool

    @classmethod
    def relative(cls, name: str, value: float, error: float, usual: float, told: bool) -> Parameter:
        """error: relative standard error; the interval is that of a logarithm."""
        wide = math.exp(NINETY * min(error, 3.0))
        return cls(name, value, value / wide, value * wide, usual, told)


@dataclass(frozen=True)
class Figure:
    """One figure of the recording beside what the cell does before and after."""

    words: str
    unit: str
    recorded: float
    before: float
    after: float


@dataclass(frozen=True)
class Finding:
    """Of one recording. kind: 'arc log', 'cooling curves' or 'wall'. misfit: before and after, in `unit`."""

    recording: str
    kind: str
    misfit: tuple[float, float]
    unit: str
    parameters: tuple[Parameter, ...]
    figures: tuple[Figure, ...]
    silent: tuple[str, ...]  # what it cannot tell, in words
    notes: tuple[str, ...] = field(default=())
