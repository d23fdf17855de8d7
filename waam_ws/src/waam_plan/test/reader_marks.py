"""Cases of clouds: marks for no return, stray points, and what must not be taken for them."""

from __future__ import annotations

import numpy as np
from reader_case import Case
from reader_clouds import (
    LEFT,
    LIT,
    MARK,
    N,
    is_surface,
    marked,
    npy,
    organised,
    plate,
    same,
    shaded,
    some,
    surface,
    text,
    through_zero,
    with_strays,
)

MARKS = [
    Case(
        f'no return as {v}',
        f'a.{k}',
        (lambda v=v, k=k: _file(marked(v), k)),
        (MARK, f'{len(some())} points'),
        check=is_surface(LEFT),
    )
    for v, k in (
        ((0, 0, 0), 'xyz'),
        ((None, None, 0), 'csv'),
        ((None, None, -99.99), 'txt'),
        ((-99.99,) * 3, 'xyz'),
        ((None, None, -32768), 'csv'),
        ((None, None, 99999), 'npy'),
        ((-9999,) * 3, 'npy'),
        ((None, None, 65535), 'xyz'),
        ((0, 0, 1e10), 'npy'),
        ((None, None, -123.456), 'xyz'),
    )
]


def _file(points: np.ndarray, kind: str) -> bytes:
    if kind == 'npy':
        return npy(points)
    head = 'x,y,z' if kind == 'csv' else ''
    return text(points, ',' if kind == 'csv' else ' ', head).encode()


MARKS += [
    Case(
        'NaN in an organised array',
        'a.npy',
        lambda: organised(np.nan),
        ('without a finite number',),
        check=is_surface(N - len(some(3))),
    ),
    Case(
        'zeros in an organised array',
        'a.npy',
        lambda: organised(0.0),
        (MARK,),
        check=is_surface(N - len(some(3))),
    ),
    Case(
        'infinity',
        'a.npy',
        lambda: npy(marked((None, None, np.inf))),
        ('infinite, huge',),
        check=is_surface(LEFT),
    ),
    Case(
        'z 0 in the shadow',
        'a.xyz',
        lambda: text(shaded(False)).encode(),
        (MARK, f'{N - LIT} points'),
        check=is_surface(LIT),
    ),
    Case(
        'z 0 with intensity 0',
        'a.csv',
        lambda: text(shaded(True), ',', 'x,y,z,intensity').encode(),
        (MARK, 'intensity 0'),
        check=is_surface(LIT),
    ),
    Case(
        'a plate at z 0 with a trough',
        'a.xyz',
        lambda: text(plate(-2)).encode(),
        check=same(lambda: plate(-2)),
    ),
    Case(
        'a plate at z 0 with a boss',
        'a.xyz',
        lambda: text(plate(20)).encode(),
        check=same(lambda: plate(20)),
    ),
    Case('a plate at z 0', 'a.xyz', lambda: text(plate(0)).encode(), check=same(lambda: plate(0))),
    Case(
        'one real point in the origin',
        'a.npy',
        lambda: npy(through_zero()),
        check=same(through_zero),
    ),
    Case(
        'a stray point 50 m away',
        'a.xyz',
        lambda: text(with_strays((5e4, 0, 20))).encode(),
        ('1 point far',),
        check=is_surface(),
    ),
    Case(
        'two stray points below',
        'a.npy',
        lambda: npy(with_strays((230, -35, -60), (240, -30, 90))),
        ('2 points far',),
        check=is_surface(),
    ),
    Case(
        'nothing but marks',
        'a.xyz',
        lambda: text(np.zeros((500, 3))).encode(),
        ('too few|mark',),
        True,
    ),
    Case(
        'all but few are marks',
        'a.xyz',
        lambda: text(np.vstack([np.zeros((5000, 3)), surface()[:60]])).encode(),
        ('60 points are too few', MARK),
        True,
    ),
    Case(
        'z 0 in four of five points',
        'a.npy',
        lambda: npy(
            np.where(np.isin(np.arange(N), some())[:, None], surface(), surface() * (1, 1, 0))
        ),
        (MARK, f'{LEFT} points'),
        check=is_surface(len(some())),
    ),
    Case(
        'z 0 between heights around 0',
        'a.npy',
        lambda: npy(
            np.where(np.isin(np.arange(N), some())[:, None], (1, 1, 0), (1, 1, 1))
            * (surface() - (0, 0, 18.5))
        ),
        (MARK, f'{len(some())} points'),
        check=is_surface(LEFT, -1.5),
    ),
    Case(
        'a plate that may be none',
        'a.npy',
        lambda: npy(plate(20)),
        ('kept, as a plate',),
        check=same(lambda: plate(20)),
    ),
    Case(
        'an archive for a text', 'a.xyz', lambda: b'\x1f\x8b' + bytes(500), ('binary data',), True
    ),
]
