"""The judge: LinuxCNC's rs274 and this controller make the same path of the same program, within 1 um.

Programs come from hypothesis, in whole ten-thousandths of the program's unit, so that the four decimals that rs274
prints lose nothing.
"""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

PROGRAMS = 300
RATE_FLOOR = 0.1  # units/min, of rs274 in G93
TOLERANCE = 1e-3  # mm
SHORTEST = 5.5e-4  # mm; a move below half a um makes no block
PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
Vector = tuple[float, ...]
PROGRAM_FILES = Path(__file__).parent / "programs"


@dataclass
class Motion:
    """One motion: rapid or not, speed in mm/s (None for rapids), points (n, 3) in machine mm."""

    rapid: bool
    speed: float | None
    points: list[Vector]

    @property
    def counts(self) -> bool:
        return sum(map(math.dist, self.points, self.points[1:])) > SHORTEST


# ---- the programs ----


@dataclass
class Writer:
    """Writes lines and keeps track of where the program is; everything in 1e-4 of the program's unit."""

    draw: st.DrawFn
    inch: bool
    lines: list[str] = field(default_factory=list)
    at: list[int] = field(default_factory=lambda: [0, 0, 0])  # machine
    frames: list[list[int]] = field(default_factory=lambda: [[0, 0, 0] for _ in range(6)])
    frame: int = 0
    g92: list[int] = field(default_factory=lambda: [0, 0, 0])
    plane: int = 17
    relative: bool = False
    absolute_centre: bool = False
    inverse: bool = False
    long_words: int = 0  # in the line that is being written

    def pick(self, *values):
        return self.draw(st.sampled_from(values))

    def length(self, most: int = 300_000) -> int:
        return self.draw(st.integers(-most, most))

    def emit(self, *words: str) -> None:
        self.long_words = 0
        number = f"N{len(self.lines) * 10} " if self.pick(0, 0, 1) else ""
        text = number + self.pick(" ", " ", "").join(w for w in words if w)
        comment = self.pick("", "", "", " (words)", " ; words")
        deleted = self.pick("", "", "", "", "/")  # the switch of block delete is off
        self.lines.append(deleted + (text.lower() if self.pick(0, 0, 0, 1) else text) + comment)

    def word(self, letter: str, value: int) -> str:
        text = f"{value / 10_000:.4f}"
        kind = self.pick('short', 'short', 'plain', 'plain', 'long', 'exact')
        if kind in ('long', 'exact') and self.long_words < 2:  # a line has at most 160 bytes
            self.long_words += 1
            return letter + (text + '0' * 20 if kind == 'long' else f'{value / 10_000:.30f}')
        return letter + (text.rstrip('0').rstrip('.') if kind == 'short' else text)

    def zero(self, axis: int) -> int:
        return self.frames[self.frame][axis] + self.g92[axis]

    def axis_words(self, target: list[int], keep: set[int], machine: bool = False) -> list[str]:
        """Words for the axes of `keep`; moves there."""
        out = []
        for i in sorted(keep):
            base = self.at[i] if self.relative else 0 if machine else self.zero(i)
            out.append(self.word("XYZ"[i], target[i] - base))
        self.at = [target[i] if i in keep else self.at[i] for i in range(3)]
        return out

    def feed(self) -> str:
        return f"F{self.pick(30, 60, 120.5, 600, 1234)}" if self.inverse or self.pick(0, 1) else ""

    def gas(self) -> str:
        return self.pick("", "", "", "M7", "M8", "M9")

    def line(self) -> None:
        keep = set(self.draw(st.lists(st.integers(0, 2), min_size=1, max_size=3)))
        machine = not self.relative and self.pick(0, 0, 0, 1)
        motion = self.pick("G0", "G1")
        words = self.axis_words([a + self.length() for a in self.at], keep, machine=bool(machine))
        self.emit(
            "G53" if machine else "",
            motion,
            *words,
            self.feed() if motion == "G1" else "",
            self.gas(),
        )

    def arc(self) -> None:
        """By centre. The end is rounded to the grid, so the radii differ by a fraction of it."""
        p, q, r = PLANES[self.plane]
        i, j = self.length(200_000), self.length(200_000)
        if abs(i) + abs(j) < 2_000:
            i = 12_345
        centre = (self.at[p] + i, self.at[q] + j)
        turn = self.pick(0.0, math.pi, *(self.draw(st.floats(0.02, 6.26)) for _ in range(3)))
        angle, radius = math.atan2(-j, -i) + turn, math.hypot(i, j)
        target = list(self.at)
        if turn:
            target[p] = round(centre[0] + radius * math.cos(angle))
            target[q] = round(centre[1] + radius * math.sin(angle))
        target[r] += self.pick(0, self.length())
        keep = {a for a in range(3) if target[a] != self.at[a] or self.pick(0, 1)}
        if self.absolute_centre:
            i, j = centre[0] - self.zero(p), centre[1] - self.zero(q)
        letters = "IJK"
        centre_words = [self.word(letters[p], i), self.word(letters[q], j)]
        words = self.axis_words(target, keep)
        self.emit(self.pick("G2", "G3"), *words, *centre_words, self.feed())

    def radius_arc(self) -> None:
        p, q, r = PLANES[self.plane]
        target = list(self.at)
        target[p] += self.length() or 5_000
        target[q] += self.length()
        target[r] += self.pick(0, self.length())
        half = math.hypot(target[p] - self.at[p], target[q] - self.at[q]) / 2
        # not exactly half a turn: there the centre hangs on the last bit of the root
        radius = math.ceil(half * self.draw(st.floats(1.001, 4.0))) + 20
        words = self.axis_words(target, {a for a in range(3) if target[a] != self.at[a]} | {p})
        sign = self.pick(1, 1, -1)
        self.emit(self.pick("G2", "G3"), *words, self.word("R", sign * radius), self.feed())

    def modal(self) -> None:
        kind = self.pick("plane", "distance", "centre", "frame", "feed", "other")
        if kind == "plane":
            self.plane = self.pick(*PLANES)
            self.emit(f"G{self.plane}")
        elif kind == "distance":
            self.relative = self.pick(False, True)
            self.emit("G91" if self.relative else "G90")
        elif kind == "centre":
            self.absolute_centre = self.pick(False, True)
            self.emit("G90.1" if self.absolute_centre else "G91.1")
        elif kind == "frame":
            self.frame = self.pick(*range(6))
            self.emit(f"G{54 + self.frame}")
        elif kind == "feed":
            self.inverse = self.pick(False, True)
            self.emit("G93" if self.inverse else "G94", "" if self.inverse else "F300")
        else:
            self.emit(
                self.pick(
                    "G4 P0",
                    "M7",
                    "M8",
                    "M9",
                    "M5",
                    "(nothing)",
                    "G80",
                    "G40 G49",
                    "G61",
                    "G64",
                    "G64 P0.02 Q0.01",
                    "F450" * (not self.inverse),
                )
            )

    def offset(self) -> None:
        kind = self.pick("L2", "L20", "G92", "G92.1")
        axes = sorted(set(self.draw(st.lists(st.integers(0, 2), min_size=1, max_size=3))))
        values = {i: self.length() for i in axes}
        words = [self.word("XYZ"[i], v) for i, v in values.items()]
        if kind == "G92.1":
            self.g92 = [0, 0, 0]
            self.emit(kind)
        elif kind == "G92":
            for i, v in values.items():
                self.g92[i] = self.at[i] - self.frames[self.frame][i] - v
            self.emit(kind, *words)
        else:
            p = self.pick(*range(7))
            frame = self.frames[p - 1 if p else self.frame]
            for i, v in values.items():
                frame[i] = v if kind == "L2" else self.at[i] - self.g92[i] - v
            self.emit("G10", kind, f"P{p}", *words)

    def any(self) -> None:
        kinds = [self.line, self.line, self.arc, self.arc, self.modal, self.offset]
        # the centre that follows from R has more than four decimals: exact to 0.1 um in mm, not in inches
        self.pick(*kinds, *([] if self.inch else [self.radius_arc, self.radius_arc]))()


@st.composite
def programs(draw: st.DrawFn) -> list[str]:
    w = Writer(draw, draw(st.sampled_from([False, False, True])))
    w.emit("G20" if w.inch else "G21", "G90")
    w.emit("F300")  # LinuxCNC would read an F beside G20 in the old unit
    for _ in range(draw(st.integers(1, 14))):
        w.any()
    w.emit(draw(st.sampled_from(["M2", "M9 M30"])))
    return ["%", *w.lines, "%"] if draw(st.booleans()) else w.lines


# ---- the two controllers ----


def numbers(text: str) -> list[float]:
    return [float(x) for x in re.findall(r"-?\d+\.\d+", text)]


class Judge:
    """Reads the canonical motions that rs274 prints; keeps units, offsets, plane and position as they say."""

    def __init__(self) -> None:
        self.unit, self.plane = 1.0, 17
        self.speed: float | None = 0.0
        self.at: Vector = (0.0, 0.0, 0.0)
        self.g5x: Vector = (0.0, 0.0, 0.0)
        self.g92: Vector = (0.0, 0.0, 0.0)
        self.motions: list[Motion] = []

    def machine(self, xyz: list[float]) -> Vector:
        return tuple(v * self.unit + a + b for v, a, b in zip(xyz, self.g5x, self.g92, strict=True))

    def straight(self, values: list[float], rapid: bool) -> None:
        end = self.machine(values[:3])
        self.motions.append(Motion(rapid, None if rapid else self.speed, [self.at, end]))
        self.at = end

    def arc(self, text: str) -> None:
        first, second, c0, c1, rise = (numbers(text)[i] for i in (0, 1, 2, 3, 4))
        turns = int(re.findall(r", (-?\d+),", text)[0])
        p, q, r = PLANES[self.plane]
        end, centre = [0.0] * 3, [0.0] * 3
        end[p], end[q], end[r] = first, second, rise
        centre[p], centre[q] = c0, c1
        self.motions.append(Motion(False, self.speed, self.round(end, centre, turns, (p, q, r))))
        self.at = self.motions[-1].points[-1]

    def round(self, end, centre, turns, axes) -> list[Vector]:
        """(17, 3): points at equal shares from here to `end` about `centre`, turning as the sign of `turns` says."""
        p, q, r = axes
        to, c = self.machine(end), self.machine(centre)
        a0 = math.atan2(self.at[q] - c[q], self.at[p] - c[p])
        a1 = math.atan2(to[q] - c[q], to[p] - c[p])
        r0 = math.hypot(self.at[q] - c[q], self.at[p] - c[p])
        r1 = math.hypot(to[q] - c[q], to[p] - c[p])
        sweep = (a1 - a0) % (2 * math.pi)
        if math.hypot(to[p] - self.at[p], to[q] - self.at[q]) < 5e-5:
            sweep = 0.0
        if turns < 0:
            sweep -= 2 * math.pi
        elif sweep == 0.0:
            sweep = 2 * math.pi
        points = []
        for k in range(17):
            s, point = k / 16, [0.0] * 3
            radius, angle = r0 + s * (r1 - r0), a0 + s * sweep
            point[p], point[q] = (
                c[p] + radius * math.cos(angle),
                c[q] + radius * math.sin(angle),
            )
            point[r] = self.at[r] + s * (to[r] - self.at[r])
            points.append(tuple(point))
        return points

    def read(self, text: str) -> None:
        values = numbers(text)
        if "USE_LENGTH_UNITS" in text:
            self.unit = 25.4 if "INCHES" in text else 1.0
        elif "SELECT_PLANE" in text:
            self.plane = {"XY": 17, "XZ": 18, "YZ": 19}[re.findall("PLANE_([XYZ]+)", text)[0]]
        elif "SET_G5X_OFFSET" in text:
            self.g5x = tuple(v * self.unit for v in values[:3])
            self.at = self.at if self.motions else (0.0, 0.0, 0.0)
        elif "SET_G92_OFFSET" in text:
            self.g92 = tuple(v * self.unit for v in values[:3])
        elif "SET_FEED_RATE" in text:
            # an inverse-time move slower than its floor is printed at the floor, whatever the program says
            self.speed = values[0] * self.unit / 60.0 if values[0] > RATE_FLOOR else None
        elif "STRAIGHT_" in text:
            self.straight(values, "TRAVERSE" in text)
        elif "ARC_FEED" in text:
            self.arc(text)


def judged(lines: list[str], folder) -> list[Motion]:
    path = folder / "program.ngc"
    path.write_text("\n".join(lines) + "\n")
    result = subprocess.run(
        ["rs274", "-g", path.name],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
    )
    errors = [x for x in result.stderr.splitlines() if x and x != "executing"]
    assert not errors, errors
    judge = Judge()
    for line in result.stdout.splitlines():
        judge.read(line)
    return [m for m in judge.motions if m.counts]


def ours(gcode_path: str, lines: list[str]) -> list[Motion]:
    result = subprocess.run(
        [gcode_path, "--no-limits", "--every", "1e9", "-"],
        input="\n".join(lines) + "\n",
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert result.returncode == 0, result.stderr
    motions = []
    for row in result.stdout.splitlines():
        _, kind, speed, *values = row.split()
        v = [float(x) for x in values]
        points = [tuple(v[i : i + 3]) for i in range(0, len(v), 3)]
        motions.append(Motion(kind == "rapid", None if kind == "rapid" else float(speed), points))
    return [m for m in motions if m.counts]


def length(motion: Motion) -> float:
    return sum(math.dist(a, b) for a, b in zip(motion.points, motion.points[1:], strict=False))


def compare(expected: list[Motion], got: list[Motion]) -> None:
    # moves below a step: one side may keep them, the other add them to the next
    if len(got) != len(expected):
        expected, got = ([m for m in side if length(m) > 3e-3] for side in (expected, got))
    assert len(got) == len(expected)
    for number, (e, g) in enumerate(zip(expected, got, strict=True)):
        assert (g.rapid, len(g.points)) == (e.rapid, len(e.points)), number
        off = max(math.dist(a, b) for a, b in zip(e.points, g.points, strict=True))
        assert off <= TOLERANCE, f"motion {number} is {off * 1000:.3f} um off"
        if e.speed is not None:
            assert g.speed == pytest.approx(e.speed, rel=1e-3, abs=1e-4), number


needs_judge = pytest.mark.skipif(
    shutil.which("rs274") is None,
    reason="LinuxCNC's rs274 (package linuxcnc-uspace) is not installed",
)


@needs_judge
def test_path_equals_that_of_linuxcnc(gcode_path, tmp_path):
    compared = []

    @settings(
        max_examples=PROGRAMS,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=[
            HealthCheck.function_scoped_fixture,
            HealthCheck.too_slow,
        ],
    )
    @given(programs())
    def same_path(lines: list[str]) -> None:
        expected = judged(lines, tmp_path)
        compare(expected, ours(gcode_path, lines))
        compared.append(len(expected))

    same_path()
    assert len(compared) >= PROGRAMS and sum(compared) > 3 * PROGRAMS


@needs_judge
@pytest.mark.parametrize("program", sorted(PROGRAM_FILES.glob("cam_*.nc")), ids=lambda p: p.stem)
def test_programs_in_the_manner_of_cam_systems(gcode_path, tmp_path, program):
    """Their beginnings and ends are read, and what lies between them is the path that rs274 makes of it."""
    lines = program.read_text().splitlines()
    expected = judged(lines, tmp_path)
    assert len(expected) >= 5
    compare(expected, ours(gcode_path, lines))
