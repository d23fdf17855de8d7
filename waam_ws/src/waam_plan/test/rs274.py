"""LinuxCNC's rs274 as judge of a program's path: its canonical motions, and how far ours are from them."""

from __future__ import annotations

import math
import random
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PLANES = {'XY': (0, 1, 2), 'XZ': (2, 0, 1), 'YZ': (1, 2, 0)}
SHORTEST = 5.5e-4  # mm; below its four decimals rs274 may leave a move out
# words of printers and welders that rs274 does not know; they move nothing
FOREIGN = re.compile(r'[MTESW]\s*-?[\d.]+|\bG(?:28|29|10|11)\b.*', re.IGNORECASE)
# lines with words of their own, M73 P0 R28, and macros of Klipper
MACHINE = re.compile(
    r'^\s*(N\d+\s*)?M(?:11[78]\b.*|\d[^G]*)$|^[A-Z][A-Z0-9]*_[A-Z0-9_]+\b', re.IGNORECASE
)
ALONE = re.compile(r'^\s*(N\d+)?\s*G92\s*$', re.IGNORECASE)  # once its E is gone


def available() -> bool:
    """Whether the judge is installed (package linuxcnc-uspace)."""
    return shutil.which('rs274') is not None


def random_program(rng: random.Random) -> str:
    """Lit moves of all kinds, words of four decimals."""
    out = ['G21 G90 G17', 'G0 Z5', 'G0 X0 Y0', 'G1 Z0 F600', 'W6000 S22', 'M3']
    for _ in range(rng.randint(2, 12)):
        radius, turn = rng.uniform(0.5, 80), rng.uniform(0.1, 6.1)
        word, sign = rng.choice((('G3', 1), ('G2', -1)))
        x, y = (radius * f(sign * turn) for f in (math.cos, math.sin))
        i, z = -radius, rng.uniform(-3, 3)
        plane = rng.choice(
            (
                f'G17 {word} X{x - radius:.4f} Y{y:.4f} Z{z:.4f} I{i:.4f}',
                f'G18 {word} Z{x - radius:.4f} X{y:.4f} Y{z:.4f} K{i:.4f}',
                f'G19 {word} Y{x - radius:.4f} Z{y:.4f} X{z:.4f} J{i:.4f}',
                f'G17 {word} X{rng.uniform(1, 9):.4f} R{rng.uniform(5.1, 30):.4f}',
            )
        )
        out.append(f'G91 {plane}')
        out.append(f'G90 G1 X{rng.uniform(-90, 90):.4f} Y{rng.uniform(-90, 90):.4f} Z0')
    return '\n'.join([*out, 'M5'])


@dataclass(frozen=True)
class Judged:
    """One canonical motion, mm. centre: in the plane of `axes`, None = a line. sweep: rad."""

    start: np.ndarray
    end: np.ndarray
    axes: tuple[int, int, int] = (0, 1, 2)
    centre: tuple[float, float] | None = None
    sweep: float = 0.0

    def at(self, share: np.ndarray) -> np.ndarray:
        """(n, 3) points at shares (n,) of the way."""
        line = self.start + share[:, None] * (self.end - self.start)
        if self.centre is None:
            return line
        p, q, _ = self.axes
        c = np.array(self.centre)
        a, b = (np.array([e[p], e[q]]) - c for e in (self.start, self.end))
        angle = math.atan2(a[1], a[0]) + share * self.sweep
        radius = np.hypot(*a) + share * (np.hypot(*b) - np.hypot(*a))
        line[:, p], line[:, q] = c[0] + radius * np.cos(angle), c[1] + radius * np.sin(angle)
        return line

    @property
    def counts(self) -> bool:
        """Whether it goes anywhere."""
        return self.centre is not None or float(np.linalg.norm(self.end - self.start)) > SHORTEST


def judged(text: str) -> list[Judged]:
    """Motions of a program; what is not RS274/NGC is left out first. Raises RuntimeError with what rs274 says."""
    lines = [re.sub(r'\([^)]*\)|;.*|\*\d+\s*$', '', x) for x in text.splitlines()]
    lines = [FOREIGN.sub('', x) for x in lines if not MACHINE.match(x)]
    plain = '\n'.join(x for x in lines if x.strip() != '%' and not ALONE.match(x))
    with tempfile.TemporaryDirectory(prefix='waam_rs274_') as scratch:
        for name in ('tool.tbl', 'rs274.var'):
            (Path(scratch) / name).touch()
        (Path(scratch) / 'program.ngc').write_text(f'G21 F600\n{plain}\nM2\n')
        command = ['rs274', '-t', 'tool.tbl', '-v', 'rs274.var', '-g', 'program.ngc']
        done = subprocess.run(command, cwd=scratch, capture_output=True, text=True, timeout=120)
    errors = [x for x in done.stderr.splitlines() if x and x != 'executing']
    if errors or done.returncode:
        raise RuntimeError(f'rs274: {"; ".join(errors)}')
    reader = _Reader()
    for line in done.stdout.splitlines():
        reader.read(line)
    return [m for m in reader.motions if m.counts]


class _Reader:
    """Units, offset of G92 and position as the canonical motions say."""

    def __init__(self) -> None:
        self.unit, self.plane = 1.0, 'XY'
        self.at, self.g92 = np.zeros(3), np.zeros(3)
        self.motions: list[Judged] = []

    def read(self, text: str) -> None:
        values = [float(x) for x in re.findall(r'-?\d+\.\d+', text)]
        if 'USE_LENGTH_UNITS' in text:
            self.unit = 25.4 if 'INCHES' in text else 1.0
        elif 'SELECT_PLANE' in text:
            self.plane = re.findall('PLANE_([XYZ]+)', text)[0]
        elif 'SET_G92_OFFSET' in text:
            self.g92 = np.array(values[:3]) * self.unit
        elif 'STRAIGHT_' in text:
            self._to(Judged(self.at, self._work(values[:3])))
        elif 'ARC_FEED' in text:
            self._arc(values, int(re.findall(r', (-?\d+),', text)[0]))

    def _work(self, values: list[float]) -> np.ndarray:
        return np.array(values) * self.unit + self.g92

    def _to(self, motion: Judged) -> None:
        self.motions.append(motion)
        self.at = motion.end

    def _arc(self, values: list[float], turns: int) -> None:
        p, q, r = axes = PLANES[self.plane]
        end, centre = np.zeros(3), np.zeros(3)
        end[[p, q, r]], centre[[p, q]] = (values[0], values[1], values[4]), values[2:4]
        end, centre = self._work(end.tolist()), self._work(centre.tolist())
        a, b = (np.arctan2(e[q] - centre[q], e[p] - centre[p]) for e in (self.at, end))
        sweep = float((b - a) % (2 * math.pi) if turns > 0 else -((a - b) % (2 * math.pi)))
        if np.hypot(end[p] - self.at[p], end[q] - self.at[q]) < 5e-5:
            sweep = 0.0
        sign, more = (1 if turns > 0 else -1), abs(turns) - (0 if sweep == 0.0 else 1)
        self._to(
            Judged(self.at, end, axes, (centre[p], centre[q]), sweep + sign * more * 2 * math.pi)
        )


def off_um(text: str, dialect: str) -> tuple[float, int]:
    """Largest distance (um) of the chords that a job lays from the judge's path, arcs at the same shares, and how many
    motions were compared. Coordinates that the program has not said yet do not count."""
    from waam_plan.import_gcode.files import load_dialect
    from waam_plan.import_gcode.reader import read_program

    program = read_program(text, load_dialect(dialect))
    ours = [m for m in program.motions if not m.dwell and not m.length * 1e3 <= SHORTEST]
    theirs = judged(text)
    known = [m for m in ours if np.isfinite([*m.start, *m.end]).all()]
    theirs = theirs[len(theirs) - len(known) :]
    worst = 0.0
    for m, judge in zip(known, theirs, strict=True):
        corners = m.corners() * 1e3
        shares = np.linspace(0.0, 1.0, len(corners))
        middles = 0.5 * (corners[1:] + corners[:-1])
        off = np.linalg.norm(corners - judge.at(shares), axis=1).max()
        between = np.linalg.norm(middles - judge.at(0.5 * (shares[1:] + shares[:-1])), axis=1)
        worst = max(worst, float(off), float(between.max()))
    return worst * 1e3, len(known)


def exact_off_um(text: str, dialect: str) -> tuple[float, int]:
    """Where there is no judge: largest distance (um) of the chords from the circles about the arcs' centres, and how
    many arcs there are."""
    from waam_plan.import_gcode.arc import PLANES as AXES
    from waam_plan.import_gcode.files import load_dialect
    from waam_plan.import_gcode.reader import read_program

    arcs = [m for m in read_program(text, load_dialect(dialect)).motions if m.round]
    worst = 0.0
    for m in arcs:
        p, q, _ = AXES[m.round.plane]
        corners = m.corners()
        shares = np.linspace(0.0, 1.0, 2 * len(corners) - 1)
        points = np.empty((len(shares), 3))
        points[::2], points[1::2] = corners, 0.5 * (corners[1:] + corners[:-1])
        away = np.hypot(points[:, p] - m.round.centre[0], points[:, q] - m.round.centre[1])
        r0, r1 = away[0], away[-1]
        worst = max(worst, float(np.abs(away - r0 - shares * (r1 - r0)).max()))
    return worst * 1e6, len(arcs)
