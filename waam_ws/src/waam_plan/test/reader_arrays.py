"""Cases of clouds in PCD, PLY and NumPy files, and of units."""

from __future__ import annotations

import numpy as np
from reader_case import Case
from reader_clouds import (
    COLUMNS,
    MARK,
    ROWS,
    N,
    box,
    compressed,
    is_surface,
    marked,
    npy,
    npz,
    organised,
    pcd_head,
    ply,
    records,
    same,
    some,
    surface,
    text,
)

F4, F8 = '<f4', '<f8'
ARRAYS = [
    Case(
        'PCD, text, z first',
        'a.pcd',
        lambda: (
            pcd_head('z intensity y x', '4 4 4 4', 'F F F F', 'ascii')
            + text(
                np.column_stack([surface()[:, 2], np.ones(N), surface()[:, 1], surface()[:, 0]])
            ).encode()
        ),
        check=is_surface(),
    ),
    Case(
        'PCD with padding',
        'a.pcd',
        lambda: (
            pcd_head('x y z _ intensity', '4 4 4 1 4', 'F F F U F', 'binary')
            + records(('x', F4), ('y', F4), ('z', F4), ('p', 'u1'), ('i', F4)).tobytes()
        ),
        check=is_surface(),
    ),
    Case(
        'PCD of doubles',
        'a.pcd',
        lambda: pcd_head('x y z', '8 8 8', 'F F F', 'binary') + surface().tobytes(),
        check=is_surface(),
    ),
    Case('PCD, compressed', 'a.pcd', compressed, check=same(lambda: np.round(surface() * 4) / 4)),
    Case('PCD, compressed, cut off', 'a.pcd', lambda: compressed(50), ('truncated',), True),
    Case(
        'PCD with a viewpoint',
        'a.pcd',
        lambda: (
            pcd_head('x y z', '8 8 8', 'F F F', 'binary', more='1 2 3 1 0 0 0')
            + surface().tobytes()
        ),
        ('VIEWPOINT',),
        check=is_surface(),
    ),
    Case(
        'PCD, cut off',
        'a.pcd',
        lambda: (pcd_head('x y z', '8 8 8', 'F F F', 'binary') + surface().tobytes())[:-9],
        ('truncated',),
        True,
    ),
    Case(
        'PCD, text, cut off',
        'a.pcd',
        lambda: pcd_head('x y z', '4 4 4', 'F F F', 'ascii') + text(surface()[:-3]).encode(),
        (f'{N} points are announced',),
        True,
    ),
    Case(
        'PCD of 10^12 points',
        'a.pcd',
        lambda: pcd_head('x y z', '4 4 4', 'F F F', 'binary', 10**12),
        ('announced',),
        True,
    ),
    Case(
        'PCD without z',
        'a.pcd',
        lambda: pcd_head('x y q', '4 4 4', 'F F F', 'binary', 0),
        ('z not',),
        True,
    ),
    Case(
        'PCD, decimal commas',
        'a.pcd',
        lambda: (
            pcd_head('x y z', '4 4 4', 'F F F', 'ascii') + text(surface(), ' ', '', True).encode()
        ),
        ('decimal comma',),
        True,
    ),
    Case(
        'PLY, text',
        'a.ply',
        lambda: ply(
            'float x, float y, float z, uchar red',
            text(np.column_stack([surface(), np.ones(N)])).encode(),
            'ascii',
        ),
        check=is_surface(),
    ),
    Case(
        'PLY, doubles, the large end first',
        'a.ply',
        lambda: ply(
            'double z, double y, double x',
            surface()[:, ::-1].astype('>f8').tobytes(),
            'binary_big_endian',
        ),
        check=is_surface(),
    ),
    Case(
        'PLY with more properties',
        'a.ply',
        lambda: ply(
            'float x, float y, float z, uchar q, float scalar_intensity',
            records(('x', F4), ('y', F4), ('z', F4), ('q', 'u1'), ('i', F4)).tobytes(),
            'binary_little_endian',
        ),
        check=is_surface(),
    ),
    Case(
        'PLY of 10^12 points',
        'a.ply',
        lambda: ply('float x, float y, float z', b'', 'binary_little_endian', 10**12),
        ('announced',),
        True,
    ),
    Case(
        'PLY without y',
        'a.ply',
        lambda: ply('float x, float z', bytes(8 * N), 'binary_little_endian'),
        ('y is needed',),
        True,
    ),
    Case(
        'whole numbers in an organised array',
        'a.npy',
        lambda: organised(-32768, np.int16),
        (MARK,),
        check=is_surface(N - len(some(3)), 16.0),
    ),
    Case(
        'records',
        'a.npy',
        lambda: npy(records(('z', F8), ('i', F4), ('x', F8), ('y', F8))),
        check=is_surface(),
    ),
    Case('points in columns', 'a.npy', lambda: npy(surface().T), (r'shape \(3, 7381\)',), True),
    Case('a picture', 'a.npy', lambda: npy(np.zeros((480, 640))), (r'shape \(480, 640\)',), True),
    Case('Python objects', 'a.npy', lambda: npy(np.array([{}] * 200, object)), ('objects',), True),
    Case(
        'an array of 10^12',
        'a.npy',
        lambda: (
            npy(np.zeros((1, 3)))
            .replace(b'(1, 3), }  ', b'(10**12,3)}')[:128]
            .replace(b'(10**12,3)}', b'(9**9, 3)} ')
        ),
        ('NumPy|announced',),
        True,
    ),
    Case(
        'an archive with points',
        'a.npz',
        lambda: npz(points=surface(), colours=np.ones((N, 3))),
        check=is_surface(),
    ),
    Case(
        'an archive with x, y, z',
        'a.npz',
        lambda: npz(
            **{a: v.reshape(ROWS, COLUMNS) for a, v in zip('xyz', surface().T, strict=True)}
        ),
        check=is_surface(),
    ),
    Case(
        'an archive of others',
        'a.npz',
        lambda: npz(a=surface(), b=surface()),
        ('none of its arrays',),
        True,
    ),
]

UNITS = [
    Case(
        'metres',
        'a.xyz',
        lambda: text(surface() / 1e3, form='%.7f').encode(),
        ('wrong units', r'--scale 1 \(m\)'),
        True,
    ),
    Case(
        'inches',
        'a.xyz',
        lambda: text(surface() / 25.4, form='%.6f').encode(),
        ('wrong units', 'inch'),
        True,
    ),
    Case('micrometres', 'a.npy', lambda: npy(surface() * 1e3), ('wrong units', 'um'), True),
    Case(
        'a scan in inches of a part in mm',
        'a.npy',
        lambda: npy((surface(0) - (200, -50, 0)) * 10 / 25.4),
        ('wrong units', 'inch and mm'),
        True,
        part=lambda: box((600, 300, 200)),
    ),
    Case(
        'a scan in metres of a part in mm',
        'a.npy',
        lambda: npy((surface(0) - (200, -50, 0)) / 1e2),
        ('wrong units',),
        True,
        part=lambda: box((600, 300, 200)),
    ),
    Case(
        'a worn mesh in inches of a part in mm',
        'a.stl',
        lambda: box((600 / 25.4, 300 / 25.4, 7)),
        ('wrong units', 'inch and mm'),
        True,
        part=lambda: box((600, 300, 200)),
    ),
    Case(
        'a scan with marks of a part',
        'a.npy',
        lambda: npy(marked((0, 0, 0)) - (200, -50, 0)),
        (MARK,),
        part=box,
    ),
]
