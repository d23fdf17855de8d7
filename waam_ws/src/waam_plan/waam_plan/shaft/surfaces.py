"""From the scan of a worn shaft to the surfaces of a restoration, on the plate of `waam_process.unrolled`.

Two kinds of files: a map of one turn (`.npz` of HeightGrid: x around the nominal surface from angle 0, as long as the
circumference, y along the axis, z = radius - nominal radius, m), or a cloud of points around the axis x = z = 0 of its
file.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from waam_plan import masks
from waam_plan.mesh.clouds import cloud_grid, is_cloud, read_cloud
from waam_plan.mesh.inputs import load_map
from waam_plan.mesh.part import Part, PartReport, read_bytes
from waam_plan.mesh.surface import top_surface
from waam_plan.settings import PlanSettings
from waam_plan.shaft import run_out
from waam_plan.shaft.run_out import RunOut
from waam_process.grid import GridSpec, HeightGrid
from waam_process.unrolled import OVERLAP, ShaftError, Unrolled

CIRCUMFERENCE = (
    0.02  # share by which a map of one turn may be longer or shorter than the nominal circumference
)
FARTHEST = 15e-3  # m from the nominal surface, beyond which half of a scan is not one of this shaft
SHORTEST = 20e-3  # m


def turn_of(path: Path, scale: float, shaft: Unrolled, cell: float) -> HeightGrid:
    """One turn of the shaft as its file has it, in the work frame (m): columns from OVERLAP, rows from y = 0, cells of
    `cell`, NaN = not seen. scale: m per unit of a cloud. ShaftError, PartError or ValueError with a text for the user.
    """
    count = shaft.period / cell
    if abs(count - round(count)) > 1e-6:
        raise ShaftError(
            f'cells of {cell * 1e3:g} mm do not divide the turn of {shaft.period * 1e3:g} mm: the grid must divide 4 mm'
        )
    turn = _of_cloud if is_cloud(path) else _of_map
    if not is_cloud(path) and path.suffix.lower() != '.npz':
        raise ShaftError(
            f'{path}: the worn surface of a shaft is a cloud (PCD, PLY, XYZ, NPY) or a map of one turn (.npz), '
            'not a mesh'
        )
    found = turn(path, scale, shaft, cell)
    y0, y1 = found.spec.extent[2:]
    if y1 - y0 < SHORTEST:
        raise ShaftError(
            f'{path}: shows {1e3 * (y1 - y0):.1f} mm of the shaft along its axis, at least '
            f'{SHORTEST * 1e3:g} mm are needed'
        )
    off = np.abs(found.z - shaft.level)
    if not np.isfinite(off).any() or np.nanmedian(off) > FARTHEST:
        far = (
            f'{1e3 * np.nanmedian(found.z - shaft.level):+.1f} mm'
            if np.isfinite(off).any()
            else 'nowhere'
        )
        raise ShaftError(
            f'{path}: the surface lies {far} from a diameter of {shaft.diameter * 1e3:g} mm (median, radial); check '
            'the diameter, the units (--scale) and that the axis of the points is y through x = z = 0'
        )
    return found


def _of_map(path: Path, scale: float, shaft: Unrolled, cell: float) -> HeightGrid:
    given = load_map(path)
    x0, x1, y0, y1 = given.spec.extent
    wanted = math.pi * shaft.diameter
    if abs((x1 - x0) / wanted - 1.0) > CIRCUMFERENCE:
        raise ShaftError(
            f'{path}: {1e3 * (x1 - x0):.1f} mm long in x, one turn of {shaft.diameter * 1e3:g} mm is '
            f'{wanted * 1e3:.1f} mm'
        )
    spec = _one_turn(shaft, y1 - y0, cell)
    beside = 2  # columns, so that the seam has neighbours
    s = given.spec
    wide = HeightGrid(
        replace(s, origin_x=s.origin_x - beside * s.resolution, cols=s.cols + 2 * beside),
        np.pad(given.z, ((0, 0), (beside, beside)), mode='wrap'),
    )
    x = x0 + (spec.x - OVERLAP) / shaft.period * (x1 - x0)
    z = wide.sample(*np.meshgrid(x, spec.y + y0))
    return HeightGrid(spec, z + shaft.level)


def _of_cloud(path: Path, scale: float, shaft: Unrolled, cell: float) -> HeightGrid:
    points = shaft.unroll(read_cloud(path, scale).points)
    low, high = points[:, 1].min(), points[:, 1].max()
    points[:, 1] -= low
    spec = _one_turn(shaft, float(high - low), cell)
    return HeightGrid(spec, cloud_grid(points, spec).z)


def _one_turn(shaft: Unrolled, length: float, cell: float) -> GridSpec:
    rows = max(1, int(length / cell + 1e-6))
    return GridSpec(OVERLAP, 0.0, cell, rows, round(shaft.period / cell))


def part_of(path: Path, scale: float, shaft: Unrolled) -> Part:
    """The nominal shaft as a plate, lower corner at zero; as long as its scan. Errors as of `turn_of`."""
    data = read_bytes(path)
    turn = turn_of(path, scale, shaft, 0.5e-3)
    length = turn.spec.extent[3]
    size = (shaft.length_x, length, shaft.level)
    mesh = trimesh.creation.box(
        size, trimesh.transformations.translation_matrix(np.array(size) / 2)
    )
    note = (
        f'shaft of {shaft.diameter * 1e3:g} mm, {length * 1e3:.1f} mm long, unrolled: one turn is '
        f'{shaft.period * 1e3:g} mm of x from {OVERLAP * 1e3:g} mm on, y is along the axis'
    )
    report = PartReport(
        faces=len(mesh.faces), area=float(mesh.area), volume=float(mesh.volume), closed=True, boundary_edges=0,
        bodies=1, collapsed_faces=0, notes=(note,),
    )  # fmt: skip
    return Part(path.stem, path, mesh, hashlib.sha256(data).hexdigest(), report)


def table_of(path: Path, scale: float, shaft: Unrolled, cell: float, margin: float) -> HeightGrid:
    """The worn shaft as it lies in a simulated cell (m, finite everywhere): the turn as often as it comes round, bare
    table beyond both ends of the shaft. Errors as of `turn_of`."""
    turn = turn_of(path, scale, shaft, cell)
    rim = math.ceil(margin / cell)
    cols = round(shaft.length_x / cell) + 2 * rim
    spec = GridSpec(-rim * cell, 0.0, cell, turn.spec.rows, cols)
    known = HeightGrid(spec, shaft.wrapped(turn, spec).z)
    z = np.pad(np.maximum(masks.fill_unknown(known.z), 0.0), ((rim, rim), (0, 0)))
    return HeightGrid(replace(spec, origin_y=-rim * cell, rows=spec.rows + 2 * rim), z)


def nominal_of(part: Part, found: HeightGrid, settings: PlanSettings) -> tuple[HeightGrid, RunOut]:
    """What is wanted on the grid of `found` (work frame, m): the plate, turned about the axis that the unworn ends of
    the scan have. ShaftError where they do not show it."""
    shaft = settings.unrolled
    assert shaft is not None
    level = top_surface(part.mesh, found.spec)
    out = run_out.fit(found, shaft, settings.shaft_ends, float(part.bounds[1, 1]))
    return level.with_z(level.z + out.over(found.spec, shaft)), out


def of_file(
    path: Path, scale: float, settings: PlanSettings
) -> tuple[HeightGrid, HeightGrid, RunOut]:
    """As found and wanted, from the file of a scan, and its run-out. Errors as of `turn_of` and `nominal_of`."""
    shaft = settings.unrolled
    assert shaft is not None
    part = part_of(path, scale, shaft)
    turn = turn_of(path, scale, shaft, settings.grid)
    spec = replace(turn.spec, origin_x=0.0, cols=round(shaft.length_x / settings.grid))
    found = shaft.wrapped(turn, spec)
    return found, *nominal_of(part, found, settings)
