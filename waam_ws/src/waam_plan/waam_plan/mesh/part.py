"""A part from a mesh file: read, checked, in metres. Every refusal says what, where and what to do."""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh

from waam_plan.mesh.crossing import crossings
from waam_plan.mesh.repair import repaired
from waam_plan.mesh.threemf import read_3mf
from waam_plan.settings import PlanSettings, Triple
from waam_robot.tilt import tilted

FORMATS = ('.stl', '.ply', '.3mf', '.obj', '.off')
SMALLEST, LARGEST = 1e-3, 2.0  # m, plausible size of a part
MAX_BYTES = 500_000_000
UNITS = {'m': 1.0, 'mm': 1e-3, 'cm': 1e-2, 'inch': 0.0254, 'um': 1e-6}


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

    def lines(self) -> list[str]:
        """For a person."""
        text = [f'{self.faces} faces, surface {self.area * 1e4:.1f} cm2, {self.bodies} bodies']
        if self.closed:
            text.append(f'closed, volume {self.volume * 1e6:.1f} cm3')
        else:
            text.append(f'open: {self.boundary_edges} boundary edges')
        if self.collapsed_faces:
            text.append(f'{self.collapsed_faces} collapsed faces were removed')
        text += [f'repaired: {r}' for r in self.repairs]
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
    mesh = _parse(path, data, scale)
    mesh.apply_scale(scale)
    a, b, c = mesh.faces.T
    collapsed = (a == b) | (b == c) | (c == a)
    mesh.update_faces(~collapsed)
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) == 0 or mesh.area <= 0:
        raise PartError(f'{path}: empty mesh, no face has an area; export the part again')
    _check_size(path, mesh, scale)
    done: list[str] = []
    if repair:
        mesh, done = repaired(mesh)
    crossing = _crossing(mesh) if look_for_crossings else ''
    report = replace(_report(mesh, int(collapsed.sum())), repairs=tuple(done), crossing=crossing)
    if require_closed:
        _check_closed(path, mesh, report)
    return Part(path.stem, path, mesh, hashlib.sha256(data).hexdigest(), report)


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


def _parse(path: Path, data: bytes, scale: float) -> trimesh.Trimesh:
    kind = path.suffix.lower()[1:]
    if kind == 'stl':
        _check_stl(path, data)
    try:
        with np.errstate(invalid='ignore', over='ignore'):  # of vertices that are refused below
            if kind == '3mf':
                vertices, faces = read_3mf(data)
                loaded = trimesh.Trimesh(vertices / scale, faces, process=False)
            else:
                loaded = trimesh.load(io.BytesIO(data), file_type=kind, process=False, force='mesh')
    except Exception as error:  # trimesh raises whatever its parsers raise
        raise PartError(f'{path}: not a readable {kind.upper()} file ({error})') from error
    if not isinstance(loaded, trimesh.Trimesh) or len(loaded.faces) == 0:
        raise PartError(f'{path}: empty mesh, the file holds no triangle')
    bad = ~np.isfinite(loaded.vertices).all(axis=1)
    if bad.any():
        face = (
            int(np.flatnonzero(bad[loaded.faces].any(axis=1))[0]) if bad[loaded.faces].any() else -1
        )
        raise PartError(
            f'{path}: {int(bad.sum())} vertices are not finite numbers (NaN or infinite), first in face {face}; '
            'the file is damaged, export it again'
        )
    mesh = trimesh.Trimesh(loaded.vertices, loaded.faces, process=False)
    mesh.merge_vertices()
    return mesh


def _check_stl(path: Path, data: bytes) -> None:
    """Truncation and the mix-up of text and binary, which lenient readers pass over."""
    head = data[:512].lstrip().lower()
    if head.startswith(b'solid') and b'facet' in data[:4096].lower():
        if b'endsolid' not in data[-512:].lower():
            raise PartError(
                f'{path}: truncated text STL, there is no "endsolid"; copy or export it again'
            )
        return
    if head.startswith(b'solid') and len(data) < 512 and b'endsolid' in data.lower():
        raise PartError(f'{path}: empty mesh, the file holds no triangle')
    if len(data) < 84:
        raise PartError(f'{path}: {len(data)} bytes are too few for an STL file; it is truncated')
    count = int.from_bytes(data[80:84], 'little')
    want = 84 + 50 * count
    if len(data) < want:
        raise PartError(
            f'{path}: truncated or corrupt STL: the header announces {count} triangles = {want} bytes, '
            f'the file has {len(data)}; copy or export it again'
        )
    if len(data) > want + 1024:
        raise PartError(
            f'{path}: corrupt STL: the header announces {count} triangles = {want} bytes, the file has '
            f'{len(data)}; export it again'
        )
    if count == 0:
        raise PartError(f'{path}: empty mesh, the header announces 0 triangles')


def _check_size(path: Path, mesh: trimesh.Trimesh, scale: float) -> None:
    size = float(np.max(mesh.extents))
    if SMALLEST <= size <= LARGEST:
        return
    fits = [
        f'{value:g} ({unit})'
        for unit, value in UNITS.items()
        if 5e-3 <= size / scale * value <= LARGEST and value != scale
    ]
    hint = (
        f'scale {" or ".join(fits)} would fit' if fits else 'no usual unit fits, check the export'
    )
    raise PartError(
        f'{path}: wrong units? With scale {scale:g} m per unit the part is {size * 1e3:.4g} mm large '
        f'(accepted {SMALLEST * 1e3:g} to {LARGEST * 1e3:g} mm); {hint}'
    )


def _report(mesh: trimesh.Trimesh, collapsed: int) -> PartReport:
    boundary = int((_edge_use(mesh)[1] == 1).sum())
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


def _edge_use(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Unique edges (n, 2) and how many faces use each."""
    return np.unique(mesh.edges_sorted, axis=0, return_counts=True)


def _check_closed(path: Path, mesh: trimesh.Trimesh, report: PartReport) -> None:
    edges, use = _edge_use(mesh)
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
    if mesh.volume < 0:
        raise PartError(
            f'{path}: inverted normals, they point into the part; flip them and export again, or --repair'
        )


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
