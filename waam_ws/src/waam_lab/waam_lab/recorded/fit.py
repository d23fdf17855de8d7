"""Recordings of any kind to one cell: each is fitted from the same cell, and what several tell is joined."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from waam_sim.plant import PlantParams

from ..twin.records import RecordError
from .arc_fit import fit_arc
from .cooling_fit import fit_cooling
from .finding import Finding, Parameter
from .read import Recording, is_wall, read
from .wall import read_wall
from .wall_fit import CELL, arc_of, fit_wall

LINEAR = ('arc_drift_correlation',)  # may be negative; others are joined by their logarithms


@dataclass(frozen=True)
class Recorded:
    """findings: what was fitted. refused: what a recording could have told and did not, and why. joined: the
    parameters of the cell file. notes: recordings that contradict each other."""

    findings: tuple[Finding, ...]
    refused: tuple[str, ...]
    joined: tuple[Parameter, ...]
    notes: tuple[str, ...]


def fit_recordings(paths: list[Path], base: PlantParams) -> Recorded:
    """RecordError when none of them tells anything."""
    findings: list[Finding] = []
    refused: list[str] = []
    for path in paths:
        try:
            _one(path, base, findings, refused)
        except ValueError as e:
            refused.append(str(e))
    if not findings:
        raise RecordError('nothing to fit: ' + '; '.join(refused))
    joined, notes = join(findings)
    return Recorded(tuple(findings), tuple(refused), joined, notes)


def _one(path: Path, base: PlantParams, findings: list[Finding], refused: list[str]) -> None:
    tries: list[Callable[[], Finding]] = []
    if is_wall(path):
        wall = read_wall(path, CELL)
        tries.append(lambda: fit_wall(path, wall, base.metal, base.arc.wire_ratio)[0])
        recording = arc_of(path, wall[1])
    else:
        recording = read(path)
    if recording.t.size:
        tries.append(lambda: fit_arc(recording, base.arc)[0])
    for topic in recording.curves:
        tries.append(partial(_cooling, recording, topic, base))
    for attempt in tries:
        try:
            findings.append(attempt())
        except RecordError as e:
            refused.append(str(e))


def _cooling(recording: Recording, topic: str, base: PlantParams) -> Finding:
    t, celsius = recording.curves[topic]
    return fit_cooling(f'{recording.name} {topic}', t, celsius, base.heat)[0]


def join(findings: list[Finding]) -> tuple[tuple[Parameter, ...], tuple[str, ...]]:
    """Told parameters with their weights (inverse variances); notes where intervals do not overlap."""
    groups: dict[str, list[tuple[Finding, Parameter]]] = {}
    for f in findings:
        for p in f.parameters:
            if p.told:
                groups.setdefault(p.name, []).append((f, p))
    joined, notes = [], []
    for name, pairs in groups.items():
        ps = [p for _, p in pairs]
        joined.append(_joined(name, ps))
        if max(p.low for p in ps) > min(p.high for p in ps):
            told = ', '.join(f'{f.recording} {p.low:.3g} .. {p.high:.3g}' for f, p in pairs)
            notes.append(
                f'{name}: the recordings contradict each other ({told}); are they of one cell?'
            )
    return tuple(joined), tuple(notes)


def _joined(name: str, ps: list[Parameter]) -> Parameter:
    if len(ps) == 1:
        return ps[0]
    line = name in LINEAR

    def to(value: float) -> float:
        return value if line else math.log(max(value, 1e-12))

    spread = np.array([max(to(p.high) - to(p.low), 1e-6) for p in ps])
    weight = spread**-2.0
    middle = float(np.sum(weight * [to(p.value) for p in ps]) / weight.sum())
    half = 0.5 / math.sqrt(float(weight.sum()))
    value, low, high = (v if line else math.exp(v) for v in (middle, middle - half, middle + half))
    return Parameter(name, value, low, high, ps[0].usual, True)
