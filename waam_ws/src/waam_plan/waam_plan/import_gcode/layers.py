"""Layers and beads of a program: stretches with the arc on, told apart by layer comments or by their height."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from waam_plan.import_gcode.motion import Motion, Program
from waam_plan.import_gcode.words import ProgramError
from waam_process.segment import Point

LEVEL = 0.15e-3  # m, beads of one layer differ by less in height
RISE = 0.3e-3  # m, more within a bead is no level one


@dataclass(frozen=True)
class Bead:
    """From arc on to arc off. way: moves and waits without arc that lead to it from the bead before."""

    motions: list[Motion]
    way: list[Motion]

    @property
    def line(self) -> int:
        """Where it begins in the program."""
        return self.motions[0].line

    @property
    def heights(self) -> tuple[float, float]:
        """Lowest and highest z, m."""
        z = [p[2] for m in self.motions for p in (m.start, m.end)]
        return min(z), max(z)

    @property
    def z(self) -> float:
        """Mean height, m."""
        moves = [m for m in self.motions if m.length > 0] or self.motions
        weights = [m.length or 1.0 for m in moves]
        return float(np.average([(m.start[2] + m.end[2]) / 2 for m in moves], weights=weights))


@dataclass(frozen=True)
class Layer:
    """Beads in the order in which they are laid."""

    number: int  # from 1
    beads: list[Bead]

    @property
    def z(self) -> float:
        """Median height of its beads, m."""
        return float(np.median([b.z for b in self.beads]))

    @property
    def level(self) -> bool:
        """Whether all of it lies at one height."""
        heights = [h for b in self.beads for h in b.heights]
        return max(heights) - min(heights) <= RISE


def beads_of(program: Program) -> list[Bead]:
    """Every stretch with the arc on that moves."""
    out: list[Bead] = []
    way: list[Motion] = []
    run: list[Motion] = []
    for m in [*program.motions, None]:
        if m is not None and m.arc:
            run.append(m)
            continue
        if any(not r.dwell for r in run):
            out.append(Bead(run, way))
        if run:
            run, way = [], []
        if m is not None:
            way.append(m)
    return out


def layers_of(program: Program) -> list[Layer]:
    """By the comments of the dialect where there are any, else by the height of the beads. ProgramError names the line
    where layers cannot be told apart."""
    beads = beads_of(program)
    if not beads:
        raise ProgramError(f'{program.name}: the arc is lit, but never moves')
    marked = any(b.motions[0].mark for b in beads)
    groups = _by_marks(beads) if marked else _by_height(beads)
    layers = [Layer(i + 1, group) for i, group in enumerate(groups)]
    for below, above in zip(layers, layers[1:], strict=False):
        if below.level and above.level and above.z < below.z - LEVEL:
            raise _falls(above.beads[0], above.z, below.z)
    return _lowered(layers) if program.height == 'top' else layers


def _falls(bead: Bead, z: float, before: float) -> ProgramError:
    return ProgramError(
        f'line {bead.line}: a bead at z = {z * 1e3:.2f} mm after one at {before * 1e3:.2f} mm: layers must rise, '
        'parts that are laid one after the other are programs of their own'
    )


def _by_marks(beads: list[Bead]) -> list[list[Bead]]:
    """What is laid before the first comment belongs to the layer that it announces."""
    out: list[list[Bead]] = []
    mark = 0
    for bead in beads:
        new = bead.motions[0].mark
        if not out or (new != mark and mark):
            out.append([])
        mark = new
        out[-1].append(bead)
    return out


def _by_height(beads: list[Bead]) -> list[list[Bead]]:
    out: list[list[Bead]] = []
    level = 0.0
    for bead in beads:
        low, high = bead.heights
        if high - low > RISE:
            raise ProgramError(
                f'line {bead.line}: the bead rises by {(high - low) * 1e3:.2f} mm, so layers cannot be told by their '
                'height; mark them by comments (key `layer` of the dialect)'
            )
        if out and bead.z < level - LEVEL:
            raise _falls(bead, bead.z, level)
        if not out or bead.z > level + LEVEL:
            out.append([])
            level = bead.z
        out[-1].append(bead)
    return out


def _lowered(layers: list[Layer]) -> list[Layer]:
    """z of the program is that of the beads' tops: down by the thickness of each layer, to what they are laid on."""
    z = [0.0, *(layer.z for layer in layers)]
    out = []
    for layer, below in zip(layers, z, strict=False):
        drop = below - layer.z
        out.append(replace(layer, beads=[_moved_bead(b, (0.0, 0.0, drop)) for b in layer.beads]))
    return out


def _moved_bead(bead: Bead, by: Point) -> Bead:
    return Bead(
        [moved_motion(m, by) for m in bead.motions], [moved_motion(m, by) for m in bead.way]
    )


def moved_motion(motion: Motion, by: Point) -> Motion:
    """The same move elsewhere. by: m."""

    def at(p: Point) -> Point:
        return p[0] + by[0], p[1] + by[1], p[2] + by[2]

    return replace(
        motion,
        start=at(motion.start),
        end=at(motion.end),
        round=motion.round.moved(by) if motion.round else None,
    )


def moved(program: Program, by: Point) -> Program:
    """The program elsewhere on the table. by: m."""
    if not any(by):
        return program
    return replace(program, motions=[moved_motion(m, by) for m in program.motions])
