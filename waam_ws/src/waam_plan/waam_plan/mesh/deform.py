"""The part as it has to be laid so that it comes out right: scaled against shrinkage, bent against warping.

Both are S3 section 4.1: a coefficient of shrinkage by which the model is scaled, and a model that was deformed before,
so that the deformation of the process brings it to the wanted shape. The field of displacements comes from a
calculation or from measured parts.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import RBFInterpolator

from waam_plan.mesh.part import Part, PartError
from waam_plan.settings import PlanSettings
from waam_plan.texts import decimal_comma

ALL = 1500  # samples up to which all of them count at every place
NEAREST = 64  # of more samples
MOST_FACES = 400_000
SHARP, ENOUGH = 1e-6, 50e-6  # m: the deformed place is looked for and has to be found to this
ROUNDS = 20
COLUMNS = 6
MOST_SAMPLES = 200_000


@dataclass(frozen=True)
class Displacements:
    """moves: (N, 3) m, by which the process moves the metal at places (N, 3) m, in the part's coordinates."""

    places: np.ndarray
    moves: np.ndarray

    def at(self, points: np.ndarray) -> np.ndarray:
        """(M, 3) m at points (M, 3): thin plates through the samples, near flat ones linear in the distance."""
        spread = np.linalg.matrix_rank(self.places - self.places.mean(axis=0), tol=1e-9)
        spatial = spread == 3 and len(self.places) > COLUMNS
        field = RBFInterpolator(
            self.places,
            self.moves,
            neighbors=None if len(self.places) <= ALL else NEAREST,
            kernel='thin_plate_spline' if spatial else 'linear',
            degree=1 if spatial else 0,
        )
        return np.asarray(field(points))


def displacements(lines: Iterable[str], scale: float, where: str) -> Displacements:
    """From lines 'x, y, z, dx, dy, dz' (commas or blanks, '#' begins a comment), m per unit `scale`.

    PartError that names file, line and fault.
    """
    rows: dict[tuple[float, ...], tuple[float, ...]] = {}
    for number, line in enumerate(lines, 1):
        text = line.split('#')[0]
        if any(decimal_comma(word) for word in text.split()[1:]):
            raise PartError(
                f'{where}, line {number}: decimal commas, or blanks and commas between numbers; export with decimal '
                'points'
            )
        words = text.replace(',', ' ').split()
        if not words:
            continue
        if len(words) != COLUMNS:
            raise PartError(f'{where}, line {number}: {len(words)} numbers, wanted x y z dx dy dz')
        values = [_number(word, where, number) * scale for word in words]
        place, move = tuple(values[:3]), tuple(values[3:])
        if rows.get(place, move) != move:
            raise PartError(f'{where}, line {number}: this place has been given another move')
        rows[place] = move
        if len(rows) > MOST_SAMPLES:
            raise PartError(f'{where}: more than {MOST_SAMPLES} places')
    if not rows:
        raise PartError(f'{where}: no displacements')
    return Displacements(np.array(list(rows)), np.array(list(rows.values())))


def _number(word: str, where: str, line: int) -> float:
    try:
        value = float(word)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise PartError(f"{where}, line {line}: '{word}' is no finite number")
    return value


def compensated(
    part: Part, settings: PlanSettings, field: Displacements | None = None
) -> tuple[Part, list[str]]:
    """The part to lay, and what was done, for a person. The same part where nothing is set."""
    remarks: list[str] = []
    if field is not None:
        part, most = predeformed(part, field, settings.bead_width)
        remarks.append(f'bent against warping by up to {most * 1e3:.2f} mm')
    if settings.shrinkage:
        part = grown(part, settings.shrinkage)
        remarks.append(
            f'scaled by {1 / (1 - settings.shrinkage):.4f} against a shrinkage of {settings.shrinkage:.2%}'
        )
    return part, remarks


def grown(part: Part, shrinkage: float) -> Part:
    """Larger by 1 / (1 - shrinkage) about its lower corner: what is laid shrinks by this share."""
    mesh = part.mesh.copy()
    low = part.bounds[0]
    mesh.apply_translation(-low)
    mesh.apply_scale(1 / (1 - shrinkage))
    mesh.apply_translation(low)
    return replace(part, mesh=mesh)


def predeformed(part: Part, field: Displacements, size: float) -> tuple[Part, float]:
    """The part whose places the field moves to where they belong: p + u(p) = wanted, by iteration; largest |u|, m.

    Faces are divided until their edges are at most `size` (m) long, or there are too many. PartError where the field is
    so steep that it folds the part.
    """
    mesh = part.mesh.copy()
    while mesh.edges_unique_length.max() > size and 4 * len(mesh.faces) <= MOST_FACES:
        mesh = mesh.subdivide()
    wanted = np.asarray(mesh.vertices)
    move, off = field.at(wanted), np.inf
    for _ in range(ROUNDS):
        again = field.at(wanted - move)
        off = float(np.linalg.norm(again - move, axis=1).max())
        move = again
        if off < SHARP:
            break
    if off > ENOUGH:
        raise PartError(
            f'{part.path}: the displacements change faster than the places they belong to; the part would be folded'
        )
    mesh.vertices = wanted - move
    return replace(part, mesh=mesh), float(np.linalg.norm(move, axis=1).max())
