"""Where a program and its nominal part lie in the work frame."""

from __future__ import annotations

import math

import numpy as np

from waam_plan.import_gcode.motion import Program
from waam_plan.import_gcode.regime import doubts
from waam_plan.plan import PlanError, check_reach
from waam_plan.settings import PlanSettings
from waam_process.segment import Point, Segment

MAX_OUTSIDE = 6e-3  # m that the path may lie outside the part that it makes


def path_box(program: Program) -> np.ndarray:
    """(2, 3) m: lowest and highest corner of the path with the arc on."""
    corners = np.vstack([m.corners(1e-4) for m in program.burning])
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def part_offset(bounds: np.ndarray, box: np.ndarray) -> tuple[Point, str]:
    """What is to be added to the coordinates of the nominal part (m), and how that was found, in words.

    bounds, box: (2, 3) m, of the part's mesh and of the path. The bottom of the part is put to z = 0. In the plane it
    stays where it is, or its lower corner goes to the work zero, as long as the path lies on it; else the middles meet.
    """
    low = -float(bounds[0, 2])
    corner = (-float(bounds[0, 0]), -float(bounds[0, 1]))
    for (x, y), how in (
        ((0.0, 0.0), 'in its own coordinates'),
        (corner, 'with its lower corner at the work zero'),
    ):
        inside = (box[0, :2] >= bounds[0, :2] + (x, y) - MAX_OUTSIDE) & (
            box[1, :2] <= bounds[1, :2] + (x, y) + MAX_OUTSIDE
        )
        if inside.all():
            return (x, y, low), f'the nominal part lies {how}'
    x, y = (float(v) for v in ((box[0] + box[1]) / 2 - (bounds[0] + bounds[1]) / 2)[:2])
    there = math.hypot(x, y)
    return (
        x,
        y,
        low,
    ), f'the middle of the nominal part was put to that of the path, {there * 1e3:.1f} mm'


def check_machine(program: Program, segments: list[Segment], settings: PlanSettings) -> None:
    """As `check_reach`, for the segments of a program: the error begins with line and word,
    or with a speed that no process has."""
    try:
        check_reach(segments, settings)
    except PlanError as e:
        said = ''.join(f'{text}; ' for text in doubts(program))
        raise PlanError(f'{said}{_leaves(program, settings)}{e}') from None


def _leaves(program: Program, settings: PlanSettings) -> str:
    """'line 7: X900: ' of the first move that leaves the machine; '' where it is none of the program's own."""
    limits = zip('XYZ', settings.machine_min, settings.machine_max, strict=True)
    box = [(i, letter, low, high) for i, (letter, low, high) in enumerate(limits)]
    for m in program.motions:
        corners = m.corners()
        for i, letter, low, high in box:
            out = corners[(corners[:, i] < low - 1e-9) | (corners[:, i] > high + 1e-9), i]
            if out.size:
                return f'line {m.line}: {letter}{out[-1] * 1e3:.6g}: '
    return ''
