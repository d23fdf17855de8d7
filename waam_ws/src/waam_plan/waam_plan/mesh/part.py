"""A part from a mesh file: read, checked, in metres. Every refusal says what, where and what to do."""

from __future__ import annotations

import hashlib
import io
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from waam_plan.mesh import bodies, ply
from waam_plan.mesh.crossing import crossings
from waam_plan.mesh.polygons import read_obj, read_off
from waam_plan.mesh.repair import repaired
from waam_plan.mesh.stl import read_stl
from waam_plan.mesh.threemf import read_3mf
from waam_plan.mesh.units import wrong_size
from waam_plan.mesh.weld import edge_use, welded
from waam_plan.settings import PlanSettings, Triple
from waam_plan.texts import text_of
from waam_robot.tilt import tilted

FORMATS = ('.stl', '.ply', '.3mf', '.obj', '.off')
MAX_BYTES = 500_000_000


class PartError(ValueError):
    """A part that cannot be used; the text names file, fault, place and remedy."""


@dataclass(frozen=True)
class PartReport:
    """What was found in the mesh. Lengths in m."""

    faces: int
    area: float
    volume: float  # m3, NaN for an open mesh
    closed: bool
    boundary_edges: int
    bodies: int
    collapsed_faces: int  # two corners in one point, removed
    repairs: tuple[str, ...] = ()  # repairs that were made, on request
    crossing: str = ''  # faces that pass through each other, if it was checked
    notes: tuple[str, ...] = ()  # what was left out, welded or assumed

    def lines(self) -> list[str]:
        """For a person."""
        text = [f'{self.faces} faces, surface {self.area * 1e4:.1f} cm2, {self.bodies} bodies']
        if self.closed:
            text.append(f'closed, volume {self.volume * 1e6:.1f} cm3')
        else:
            text.append(f'open: {self.boundary_edges} boundary edges')
        if self.collapsed_faces:
            text.append(f'{self.collapsed_faces} collapsed faces were removed')
        text += [*self.notes, *(f'repaired: {r}' for r in self.repairs)]
        return text + ([self.crossing] if self.crossing else [])


@dataclass(frozen=True)
class Part:
    """A mesh in metres, in the coordinates of its file (times scale)."""

    name: str
    path: Path
    mesh: trimesh.Trimesh
    sha256: str
    report: PartReport

    @property
    def bounds(self) -> np.ndarray:
        """[[x0, y0, z0], [x1, y1, z1]] m"""
        return self.mesh.bounds

    def moved(self, offset: Triple) -> Part:
        """A copy shifted by offset (m)."""
        mesh = self.mesh.copy()
        mesh.apply_translation(offset)
        return Part(self.name, self.path, mesh, self.sha256, self.report)

    def tilted(self, degrees: float, about: np.ndarray | None = None) -> Part:
        """A copy tilted (waam_robot.tilt) about a point (3,), its lower corner by default, which becomes the zero of
        its coordinates; itself at 0."""
        if not degrees:
            return self
        mesh = self.mesh.copy()
        pivot = mesh.bounds[0] if about is None else about
        mesh.vertices = tilted(mesh.vertices - pivot, np.radians(degrees))
        return Part(self.name, self.path, mesh, self.sha256, self.report)


def load_part(
    path: Path | str,
    scale: float = 1e-3,
    require_closed: bool = True,
    repair: bool = False,
    look_for_crossings: bool = False,
) -> Part:
    """Read a mesh file; scale is m per unit of the file (STL has no units; 1e-3 = mm; 3MF knows its own).

    require_closed=False accepts open meshes and wrong normals, enough where only the top surface is used.
    repair: close holes, remove double faces, turn normals outwards (PartReport.repairs). Raises PartError.
    """
    path = Path(path)
    if not (np.isfinite(scale) and scale > 0):
        raise PartError(f'scale is {scale}, must be a positive length in m per unit of the file')
    data = _read(path)
    mesh, notes = _parse(path, data, scale)
    with np.errstate(over='ignore', invalid='ignore'):
        mesh.apply_scale(scale)
        size = float(np.ptp(mesh.vertices, axis=0).max())
    if wrong := wrong_size(size, scale, 'part'):
        raise PartError(f'{path}: {wrong}')
    mesh.merge_vertices()
    collapsed = _without_collapsed(mesh)
    if len(mesh.faces) == 0 or mesh.area <= 0:
        raise PartError(f'{path}: empty mesh, no face has an area; export the part again')
    mesh, weld = welded(mesh)
    if weld:
        notes.append(weld)
        collapsed += _without_collapsed(mesh)
    done: list[str] = []
    if repair:
        try:
            mesh, done = repaired(mesh)
        except ValueError as error:
            raise PartError(f'{path}: {error}') from None
    crossing = _crossing(mesh) if look_for_crossings else ''
    report = _report(mesh, collapsed)
    report = replace(report, repairs=tuple(done), crossing=crossing, notes=tuple(notes))
    if require_closed:
        _check_closed(path, mesh, report)
    return Part(path.stem, path, mesh, hashlib.sha256(data).hexdigest(), report)


def _without_collapsed(mesh: trimesh.Trimesh) -> int:
    """Removes faces with two corners in one point from the mesh; how many."""
    a, b, c = mesh.faces.T
    collapsed = (a == b) | (b == c) | (c == a)
    mesh.update_faces(~collapsed)
    mesh.remove_unreferenced_vertices()
    return int(collapsed.sum())


def _crossing(mesh: trimesh.Trimesh) -> str:
    """For a person; empty where no faces cross."""
    try:
        count, at = crossings(np.asarray(mesh.triangles), np.asarray(mesh.faces))
    except ValueError as error:
        return f'self-intersection: not looked for, {error}'
    if not count or at is None:
        return ''
    return (
        f'self-intersection: {count} pairs of faces pass through each other, one at {_mm(at)}; bodies that overlap '
        'are united in every section, a fold is not: look at it'
    )


def check_fits(part: Part, settings: PlanSettings) -> None:
    """Raises PartError when the part is larger than the travel of the machine."""
    size = part.bounds[1] - part.bounds[0]
    travel = np.subtract(settings.machine_max, settings.machine_min)
    for axis, name in enumerate('xy'):
        if size[axis] > travel[axis] + 1e-9:
            raise PartError(
                f'{part.path}: outside the machine: {size[axis] * 1e3:.1f} mm along {name}, the machine travels '
                f'{travel[axis] * 1e3:.1f} mm; turn, split or scale the part'
            )


def _read(path: Path) -> bytes:
    if path.suffix.lower() not in FORMATS:
        raise PartError(f'{path}: unknown kind of file, readable are {", ".join(FORMATS)}')
    return read_bytes(path)


def read_bytes(path: Path) -> bytes:
    """The whole file. PartError where there is none, or it is empty or too large."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise PartError(f'{path}: larger than {MAX_BYTES // 1_000_000} MB; simplify the mesh')
        data = path.read_bytes()
    except FileNotFoundError:
        raise PartError(f'{path}: no such file') from None
    except OSError as error:
        raise PartError(f'{path}: cannot be read: {error.strerror}') from error
    if not data:
        raise PartError(f'{path}: the file is empty')
    return data


def _parse(path: Path, data: bytes, scale: float) -> tuple[trimesh.Trimesh, list[str]]:
    """The mesh in units of the file, and what a person should know."""
    kind = path.suffix.lower()[1:]
    notes: list[str] = []
    try:
        with np.errstate(invalid='ignore', over='ignore'):  # of vertices that are refused below
            if kind == '3mf':
                vertices, faces, notes = read_3mf(data)
                loaded = trimesh.Trimesh(vertices / scale, faces, process=False)
            elif kind == 'stl':
                corners, notes = read_stl(data)
                faces = np.arange(3 * len(corners)).reshape(-1, 3)
                loaded = trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False)
            elif kind in ('obj', 'off'):
                vertices, faces, notes = (read_obj if kind == 'obj' else read_off)(text_of(data))
                loaded = trimesh.Trimesh(vertices, faces, process=False)
            else:
                loaded, notes = _ply(data)
    except Exception as error:  # trimesh raises whatever its parsers raise
        raise PartError(f'{path}: not a readable {kind.upper()} file ({error})') from error
    if not isinstance(loaded, trimesh.Trimesh) or len(loaded.faces) == 0:
        raise PartError(f'{path}: empty mesh, the file holds no triangle')
    faces = np.asarray(loaded.faces)
    if faces.min() < 0 or faces.max() >= len(loaded.vertices):
        raise PartError(f'{path}: a face refers to a vertex that is not there; the file is damaged')
    bad = ~np.isfinite(loaded.vertices).all(axis=1)
    if bad.any():
        face = int(np.flatnonzero(bad[faces].any(axis=1))[0]) if bad[faces].any() else -1
        raise PartError(
            f'{path}: {int(bad.sum())} vertices are not finite numbers (NaN or infinite), first in face {face}; '
            'the file is damaged, export it again'
        )
    return trimesh.Trimesh(loaded.vertices, faces, process=False), notes


def _ply(data: bytes) -> tuple[trimesh.Trimesh, list[str]]:
    """ValueError where the cause is known."""
    header = ply.read_header(data)
    if header.count('face') == 0:
        raise ValueError('it holds points and no faces; a scan belongs to --as-found')
    if not header.order and (comma := re.search(rb'\d,\d', data[header.end :])):
        line = data.count(b'\n', 0, header.end + comma.start()) + 1
        raise ValueError(f'line {line}: a number has a decimal comma; export with decimal points')
    mesh = trimesh.load(io.BytesIO(data), file_type='ply', process=False, force='mesh')
    if len(mesh.faces) <= header.count('face'):
        return mesh, []
    return mesh, ['faces of more than three corners were divided from their first corner']


def _report(mesh: trimesh.Trimesh, collapsed: int) -> PartReport:
    boundary = int((edge_use(mesh)[1] == 1).sum())
    closed = bool(mesh.is_watertight)
    volume = float(mesh.volume) if closed else float('nan')
    bodies = int(mesh.body_count)
    return PartReport(
        faces=len(mesh.faces),
        area=float(mesh.area),
        volume=volume,
        closed=closed,
        boundary_edges=boundary,
        bodies=bodies,
        collapsed_faces=collapsed,
    )


def _check_closed(path: Path, mesh: trimesh.Trimesh, report: PartReport) -> None:
    edges, use = edge_use(mesh)
    if (use > 2).any():
        at = mesh.vertices[edges[use > 2][0]].mean(axis=0)
        raise PartError(
            f'{path}: {int((use > 2).sum())} non-manifold edges (shared by more than two faces), first at {_mm(at)}; '
            'repair the mesh (merge or separate the bodies that touch there)'
        )
    if report.boundary_edges:
        loops = _holes(edges[use == 1])
        centre = mesh.vertices[np.unique(loops[0])].mean(axis=0)
        raise PartError(
            f'{path}: open mesh: {report.boundary_edges} boundary edges in {len(loops)} holes, the first '
            f'({len(loops[0])} edges) around {_mm(centre)}; close it (--repair), build it as a wall of one bead '
            '(strategy shell), or use it in restore mode, which needs its top surface only'
        )
    if not mesh.is_winding_consistent:
        raise PartError(
            f'{path}: faces are wound in different directions; unify the normals and export again, or --repair'
        )
    if abs(mesh.volume) < 1e-12:
        raise PartError(f'{path}: zero volume, the part is flat; give it a thickness')
    try:
        wrong = bodies.fault(mesh, bodies.bodies_of(mesh))
    except ValueError as error:
        wrong = str(error)
    if wrong:
        raise PartError(f'{path}: {wrong}')


def _holes(edges: np.ndarray) -> list[np.ndarray]:
    """Boundary edges grouped into connected holes, in the order of their lowest vertex index."""
    groups = trimesh.graph.connected_components(edges, min_len=1)
    of = {int(v): i for i, group in enumerate(groups) for v in group}
    label = np.array([of[int(v)] for v in edges[:, 0]])
    holes = [edges[label == i] for i in np.unique(label)]
    return sorted(holes, key=lambda e: int(e.min()))


def _mm(point: np.ndarray) -> str:
    x, y, z = np.asarray(point) * 1e3
    return f'({x:.1f}, {y:.1f}, {z:.1f}) mm'
