"""Cases of meshes: STL in all its writings, bodies that are inside out or within each other, PLY, OBJ, OFF, units."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from reader_case import Case

Mesh = trimesh.Trimesh


def box(
    size: tuple[float, float, float] = (60, 40, 20), at: tuple[float, float, float] = (0, 0, 0)
) -> Mesh:
    """Lower corner at `at`, mm."""
    mesh = trimesh.creation.box(extents=size)
    mesh.apply_translation(np.array(size) / 2 + at)
    return mesh


def inside_out(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


def both(*meshes: Mesh) -> Mesh:
    return trimesh.util.concatenate(meshes)


def stl(mesh: Mesh) -> bytes:
    return mesh.export(file_type='stl')


def ascii_stl(mesh: Mesh | None = None, name: str = 'part') -> str:
    out = [f'solid {name}']
    for corners in (mesh or box()).triangles:
        out += ['  facet normal 0 0 0', '    outer loop']
        out += ['      vertex ' + ' '.join(f'{v:.6e}' for v in c) for c in corners]
        out += ['    endloop', '  endfacet']
    return '\n'.join([*out, f'endsolid {name}', ''])


def holds(volume: float, bodies: int = 1) -> Callable[[Any], None]:
    """volume: mm3."""

    def check(part: Any) -> None:
        assert abs(part.report.volume * 1e9 - volume) < 1e-3 * volume, part.report.volume * 1e9
        assert part.report.bodies == bodies, part.report.bodies

    return check


def cracked(size: float) -> bytes:
    """mm: every corner of every triangle is off by up to so much."""
    mesh = box().subdivide().subdivide()
    corners = mesh.triangles + np.random.default_rng(3).uniform(
        -size / 2, size / 2, (len(mesh.faces), 3, 3)
    )
    flat = Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False)
    return stl(flat)


def with_collapsed() -> bytes:
    mesh = box()
    faces = np.vstack([mesh.faces, [[0, 0, 1], [2, 3, 3]]])
    return stl(Mesh(mesh.vertices, faces, process=False))


def patched(data: bytes, at: int, new: bytes) -> bytes:
    return data[:at] + new + data[at + len(new) :]


FULL = 60 * 40 * 20
HOLLOW = FULL - 20 * 10 * 10
INNER = (20, 10, 10), (10, 10, 5)
BODIES = [
    (
        'two bodies, one inside out',
        lambda: both(box(), inside_out(box((20, 20, 10), (80, 0, 0)))),
        ('body 2 of 2', 'inside out', r'\(90.0, 10.0, 5.0\) mm', '--repair'),
        None,
    ),
    (
        'the large body inside out',
        lambda: both(inside_out(box()), box((20, 20, 10), (80, 0, 0))),
        ('body 1 of 2', 'inside out'),
        None,
    ),
    (
        'all inside out',
        lambda: both(inside_out(box()), inside_out(box((20, 20, 10), (80, 0, 0)))),
        ('inverted normals', '--repair'),
        None,
    ),
    ('a cavity', lambda: both(box(), inside_out(box(*INNER))), (), holds(HOLLOW, 2)),
    (
        'a body within a body',
        lambda: both(box(), box(*INNER)),
        ('body 2 of 2', 'within another'),
        None,
    ),
    (
        'a body in a cavity',
        lambda: both(box(), inside_out(box(*INNER)), box((6, 6, 6), (15, 12, 7))),
        (),
        holds(HOLLOW + 216, 3),
    ),
    ('two bodies', lambda: both(box(), box((20, 20, 10), (80, 0, 0))), (), holds(FULL + 4000, 2)),
    (
        'bodies that overlap',
        lambda: both(box(), box((20, 20, 10), (50, 10, 5))),
        (),
        holds(FULL + 4000, 2),
    ),
]


def _bodies() -> list[Case]:
    out = []
    for kind in ('stl', 'ply', 'obj', 'off'):
        for about, mesh, words, check in BODIES:
            if kind in ('stl', 'ply') or check is None:
                data = lambda mesh=mesh, kind=kind: _exported(mesh(), kind)  # noqa: E731
                out.append(
                    Case(
                        about, f'a.{kind}', data, words, check is None, check or (lambda got: None)
                    )
                )
    return out


def _exported(mesh: Mesh, kind: str) -> bytes:
    data = mesh.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


STL = [
    Case('text', 'a.stl', lambda: ascii_stl().encode(), check=holds(FULL)),
    Case('a byte order mark', 'a.stl', lambda: ascii_stl().encode('utf-8-sig'), check=holds(FULL)),
    Case('UTF-16', 'a.stl', lambda: ascii_stl().encode('utf-16'), check=holds(FULL)),
    Case(
        'UTF-16 without a mark', 'a.stl', lambda: ascii_stl().encode('utf-16-le'), check=holds(FULL)
    ),
    Case('CR alone', 'a.stl', lambda: ascii_stl().replace('\n', '\r').encode(), check=holds(FULL)),
    Case(
        'CR and LF', 'a.stl', lambda: ascii_stl().replace('\n', '\r\n').encode(), check=holds(FULL)
    ),
    Case('tabs', 'a.stl', lambda: ascii_stl().replace('  ', '\t').encode(), check=holds(FULL)),
    Case('capitals', 'a.stl', lambda: ascii_stl().upper().encode(), check=holds(FULL)),
    Case(
        'other letters in the name',
        'a.stl',
        lambda: ascii_stl(name='Деталь facet').encode('cp1251'),
        check=holds(FULL),
    ),
    Case(
        'two solids',
        'a.stl',
        lambda: (ascii_stl() + ascii_stl(box((9, 9, 9), (80, 0, 0)), 'b')).encode(),
        ('2 solids',),
        check=holds(FULL + 729, 2),
    ),
    Case(
        'decimal commas',
        'a.stl',
        lambda: ascii_stl().replace('.', ',').encode(),
        ('line 4', "'[0-9,e+]+' has a decimal comma"),
        True,
    ),
    Case(
        'cut off in a facet',
        'a.stl',
        lambda: ascii_stl()[:700].encode(),
        ('truncated text STL', 'line'),
        True,
    ),
    Case(
        'cut off between facets',
        'a.stl',
        lambda: ascii_stl().split('endsolid')[0].encode(),
        ('truncated text STL', 'endsolid'),
        True,
    ),
    Case(
        'a facet of four corners',
        'a.stl',
        lambda: ascii_stl().replace('    endloop', '      vertex 1 2 3\n    endloop', 1).encode(),
        ('line 2', '4 corners'),
        True,
    ),
    Case(
        'words between facets',
        'a.stl',
        lambda: ascii_stl().replace('  endfacet', '  endfacet\n  hole 3', 1).encode(),
        ("line 9: 'hole 3",),
        True,
    ),
    Case(
        'a word for a number',
        'a.stl',
        lambda: ascii_stl().replace('vertex 0.000000e+00', 'vertex abc', 1).encode(),
        ("'abc' is no number",),
        True,
    ),
    Case(
        'NaN',
        'a.stl',
        lambda: ascii_stl().replace('vertex 0.000000e+00', 'vertex nan', 1).encode(),
        ('not finite',),
        True,
    ),
    Case(
        'solid and facet in a binary header',
        'a.stl',
        lambda: patched(stl(box()), 0, b'solid facet normal'.ljust(80)),
        check=holds(FULL),
    ),
    Case(
        'the same, cut off',
        'a.stl',
        lambda: patched(stl(box()), 0, b'solid facet normal'.ljust(80))[:-70],
        ('truncated', '12 triangles'),
        True,
    ),
    Case(
        'binary with too many announced',
        'a.stl',
        lambda: patched(stl(box()), 80, (10**9).to_bytes(4, 'little')),
        ('1000000000 triangles', 'truncated'),
        True,
    ),
    Case(
        'binary with too few announced',
        'a.stl',
        lambda: patched(stl(box().subdivide().subdivide()), 80, (12).to_bytes(4, 'little')),
        ('12 triangles', 'corrupt'),
        True,
    ),
    Case(
        'binary with a tail',
        'a.stl',
        lambda: stl(box()) + bytes(30),
        ('30 bytes',),
        check=holds(FULL),
    ),
    Case(
        'binary NaN',
        'a.stl',
        lambda: patched(stl(box()), 84 + 150 + 12, b'\0\0\xc0\x7f'),
        ('not finite', 'face 3'),
        True,
    ),
    Case(
        'cracks of 1 um',
        'a.stl',
        lambda: cracked(1e-3),
        ('corners .* apart were welded', 'tolerance 20 um'),
        check=holds(FULL),
    ),
    Case('cracks of 0.3 mm', 'a.stl', lambda: cracked(0.3), ('open mesh', 'boundary edges'), True),
    Case('collapsed faces', 'a.stl', with_collapsed, ('2 collapsed faces',), check=holds(FULL)),
    Case(
        'metres',
        'a.stl',
        lambda: stl(box((0.06, 0.04, 0.02))),
        ('wrong units', r'--scale 1 \(m\)'),
        True,
    ),
    Case(
        'inches',
        'a.stl',
        lambda: stl(box((60 / 25.4, 40 / 25.4, 20 / 25.4))),
        ('wrong units', 'inch'),
        True,
    ),
    Case(
        'micrometres',
        'a.stl',
        lambda: stl(box((60e3, 40e3, 20e3))),
        ('wrong units', r'--scale 1e-06 \(um\)'),
        True,
    ),
]

OBJ = """v 0 0 0\nv 60 0 0\nv 0 40 0\nv 0 0 20\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"""
OTHERS = [
    Case('OBJ with a byte order mark', 'a.obj', lambda: OBJ.encode('utf-8-sig'), check=holds(8000)),
    Case('OBJ, CR alone', 'a.obj', lambda: OBJ.replace('\n', '\r').encode(), check=holds(8000)),
    Case('OBJ, UTF-16', 'a.obj', lambda: OBJ.encode('utf-16'), check=holds(8000)),
    Case(
        'OBJ, decimal commas',
        'a.obj',
        lambda: OBJ.replace('v 60 0', 'v 60,5 0,5').encode(),
        ('line 2', "'60,5'.*decimal comma"),
        True,
    ),
    Case(
        'OBJ, a corner that is not there',
        'a.obj',
        lambda: OBJ.replace('f 1 3 2', 'f 1 3 9').encode(),
        ('not there|not a readable',),
        True,
    ),
    Case(
        'OBJ, free-form surface',
        'a.obj',
        lambda: (OBJ + 'surf 0 1 0 1 1 2 3 4\n').encode(),
        ('line 9', 'surf'),
        True,
    ),
    Case(
        'OFF, UTF-16',
        'a.off',
        lambda: box().export(file_type='off').encode('utf-16'),
        check=holds(FULL),
    ),
    Case(
        'PLY, 10^12 faces',
        'a.ply',
        lambda: box().export(file_type='ply').replace(b'face 12', b'face 1000000000000'),
        ('element face: 1000000000000',),
        True,
    ),
    Case(
        'PLY, cut off',
        'a.ply',
        lambda: box().export(file_type='ply')[:-40],
        ('not a readable|truncated',),
        True,
    ),
    Case(
        'PLY, decimal commas',
        'a.ply',
        lambda: (
            box((60.5, 40.5, 20.5)).export(file_type='ply', encoding='ascii').replace(b'.5', b',5')
        ),
        ('decimal comma',),
        True,
    ),
    Case('wrong name', 'a.stl', lambda: b'PK\x03\x04' + bytes(300), ('STL',), True),
    Case(
        'another kind', 'a.step', lambda: b'ISO-10303-21;', ('unknown kind of file', '.stl'), True
    ),
]
CASES = [*STL, *_bodies(), *OTHERS]
