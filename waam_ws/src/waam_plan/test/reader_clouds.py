"""Cases of clouds: marks for no return, text in all its forms, PCD, PLY, NumPy, units."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable

import numpy as np
import trimesh
from reader_case import Case, GotCloud

ROWS, COLUMNS = 61, 121
MARK = "mark for no return"


def surface(noise: float = 0.01) -> np.ndarray:
    """(7381, 3) mm: a worn zone of 60 x 30 mm with a trough, corner at (200, -50), z 17 to 20."""
    y, x = np.mgrid[0 : 30 : ROWS * 1j, 0 : 60 : COLUMNS * 1j]
    z = 20 - 3 * np.exp(-(((x - 30) / 12) ** 2))
    z += noise * np.random.default_rng(1).standard_normal(z.shape)
    return np.column_stack([x.ravel() + 200, y.ravel() - 50, z.ravel()])


def is_surface(count: int = ROWS * COLUMNS, low: float = 17.0) -> Callable[[GotCloud], None]:
    """The points are those of `surface`, or `count` of them; the work zero is their lowest height."""

    def check(got: GotCloud) -> None:
        assert len(got.points) == count, f'{len(got.points)} points, not {count}'
        size = np.ptp(got.points, axis=0)
        assert np.allclose(size[:2], (0.060, 0.030), atol=1e-3), size
        assert np.allclose(got.points[:, 0].min(), 0.2, atol=1e-3), got.points[0]
        assert abs(got.low - low * 1e-3) < 0.15e-3, got.low

    return check


def some(share: int = 5) -> np.ndarray:
    """Every so-manieth point, at random places."""
    return np.random.default_rng(2).permutation(ROWS * COLUMNS)[: ROWS * COLUMNS // share]


def marked(value: tuple[float | None, ...], share: int = 5) -> np.ndarray:
    """`surface` with a mark in a share of the points; None keeps a coordinate."""
    points = surface()
    for axis, v in enumerate(value):
        if v is not None:
            points[some(share), axis] = v
    return points


def text(
    points: np.ndarray, delimiter: str = ' ', head: str = '', comma: bool = False, end: str = '\n', form: str = '%.4f'
) -> str:
    out = io.StringIO()
    np.savetxt(out, points, form, delimiter if not comma else '|')
    body = out.getvalue().replace('.', ',').replace('|', delimiter) if comma else out.getvalue()
    return (head + '\n' if head else '').replace('\n', end) + body.replace('\n', end)


def npy(a: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, a)
    return out.getvalue()


def npz(**arrays: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def pcd_head(fields: str, size: str, kind: str, data: str, count: int | None = None, more: str = '') -> bytes:
    n = ROWS * COLUMNS if count is None else count
    ones = ' '.join('1' for _ in fields.split())
    return (
        f'# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {size}\nTYPE {kind}\nCOUNT {ones}\nWIDTH {n}\nHEIGHT 1\n'
        f'VIEWPOINT {more or "0 0 0 1 0 0 0"}\nPOINTS {n}\nDATA {data}\n'
    ).encode()


def packed(data: bytes) -> bytes:
    """LZF with matches of what came 4 to 8 bytes before, else runs."""
    out, run, at = bytearray(), bytearray(), 0

    def flush() -> None:
        for k in range(0, len(run), 32):
            out.extend(bytes([len(run[k : k + 32]) - 1]) + run[k : k + 32])
        run.clear()

    while at < len(data):
        best = max(
            ((_alike(data, at, back), back) for back in (1, 4, 8) if back <= at), default=(0, 0)
        )
        if best[0] >= 3:
            flush()
            length, back = best[0] - 2, best[1] - 1
            if length < 7:
                out.extend([(length << 5) + (back >> 8), back & 255])
            else:
                out.extend([(7 << 5) + (back >> 8), length - 7, back & 255])
            at += best[0]
        else:
            run.append(data[at])
            at += 1
    flush()
    return bytes(out)


def _alike(data: bytes, at: int, back: int) -> int:
    n = 0
    while n < 264 and at + n < len(data) and data[at + n] == data[at + n - back]:
        n += 1
    return n


def compressed(cut: int = 0) -> bytes:
    points = np.round(surface() * 4) / 4
    raw = points.astype('<f4').T.tobytes()
    body = packed(raw)
    head = pcd_head('x y z', '4 4 4', 'F F F', 'binary_compressed')
    return (head + struct.pack('<II', len(body), len(raw)) + body)[: -cut or None]


def ply(fields: str, data: bytes, form: str, count: int = ROWS * COLUMNS) -> bytes:
    properties = ''.join(f'property {f}\n' for f in fields.split(', '))
    return f'ply\nformat {form} 1.0\ncomment made here\nelement vertex {count}\n{properties}end_header\n'.encode() + data


def records(*names: tuple[str, str]) -> np.ndarray:
    a = np.zeros(ROWS * COLUMNS, list(names))
    for axis, v in zip('xyz', surface().T, strict=True):
        a[axis] = v
    return a


def organised(fill: float, kind: type = float) -> bytes:
    points = surface()
    points[some(3)] = fill
    return npy(points.reshape(ROWS, COLUMNS, 3).astype(kind))


def shaded(intensity: bool) -> np.ndarray:
    """A region of the scan lies in the shadow: z = 0 there."""
    points = surface(0.02)
    dark = (points[:, 0] > 240) & (points[:, 1] > -35)
    points[dark, 2] = 0
    bright = np.where(dark, 0.0, 120.0)
    return np.column_stack([points, bright]) if intensity else points


def plate(top: float) -> np.ndarray:
    """Exactly z = 0, with a boss, or with a trough where `top` is below 0."""
    points = surface(0.0)
    middle = (np.abs(points[:, 0] - 230) < 12) & (np.abs(points[:, 1] + 35) < 8)
    points[:, 2] = np.where(middle, top, 0.0)
    return points


def through_zero() -> np.ndarray:
    """A surface with one point in the origin."""
    points = surface(0.0) - (200, -50, 20)
    points[:, 2] = -0.02 * points[:, 0]
    return points


def with_strays(*strays: tuple[float, float, float]) -> np.ndarray:
    return np.vstack([surface(), strays])


def box(size: tuple[float, float, float] = (60, 30, 20)) -> bytes:
    mesh = trimesh.creation.box(extents=size)
    mesh.apply_translation(np.array(size) / 2)
    return mesh.export(file_type='stl')


def same(expected: Callable[[], np.ndarray]) -> Callable[[GotCloud], None]:
    def check(got: GotCloud) -> None:
        want = expected() * 1e-3
        assert got.points.shape == want.shape, f'{len(got.points)} points, not {len(want)}'
        assert np.allclose(got.points, want, atol=1e-6)

    return check


N = ROWS * COLUMNS
LEFT = N - len(some())
LIT = int((~((surface()[:, 0] > 240) & (surface()[:, 1] > -35))).sum())

MARKS = [
    Case(f'no return as {v}', f'a.{k}', (lambda v=v, k=k: _file(marked(v), k)), (MARK, f'{len(some())} points'),
         check=is_surface(LEFT))
    for v, k in (
        ((0, 0, 0), 'xyz'), ((None, None, 0), 'csv'), ((None, None, -99.99), 'txt'), ((-99.99,) * 3, 'xyz'),
        ((None, None, -32768), 'csv'), ((None, None, 99999), 'npy'), ((-9999,) * 3, 'npy'),
        ((None, None, 65535), 'xyz'), ((0, 0, 1e10), 'npy'), ((None, None, -123.456), 'xyz'),
    )
]  # fmt: skip


def _file(points: np.ndarray, kind: str) -> bytes:
    if kind == 'npy':
        return npy(points)
    head = 'x,y,z' if kind == 'csv' else ''
    return text(points, ',' if kind == 'csv' else ' ', head).encode()


MARKS += [
    Case('NaN in an organised array', 'a.npy', lambda: organised(np.nan), ('without a finite number',), check=is_surface(N - len(some(3)))),
    Case('zeros in an organised array', 'a.npy', lambda: organised(0.0), (MARK,), check=is_surface(N - len(some(3)))),
    Case('infinity', 'a.npy', lambda: npy(marked((None, None, np.inf))), ('infinite, huge',), check=is_surface(LEFT)),
    Case('z 0 in the shadow', 'a.xyz', lambda: text(shaded(False)).encode(), (MARK, f'{N - LIT} points'), check=is_surface(LIT)),
    Case('z 0 with intensity 0', 'a.csv', lambda: text(shaded(True), ',', 'x,y,z,intensity').encode(), (MARK, 'intensity 0'), check=is_surface(LIT)),
    Case('a plate at z 0 with a trough', 'a.xyz', lambda: text(plate(-2)).encode(), check=same(lambda: plate(-2))),
    Case('a plate at z 0 with a boss', 'a.xyz', lambda: text(plate(20)).encode(), check=same(lambda: plate(20))),
    Case('a plate at z 0', 'a.xyz', lambda: text(plate(0)).encode(), check=same(lambda: plate(0))),
    Case('one real point in the origin', 'a.npy', lambda: npy(through_zero()), check=same(through_zero)),
    Case('a stray point 50 m away', 'a.xyz', lambda: text(with_strays((5e4, 0, 20))).encode(), ('1 point far',), check=is_surface()),
    Case('two stray points below', 'a.npy', lambda: npy(with_strays((230, -35, -60), (240, -30, 90))), ('2 points far',), check=is_surface()),
    Case('nothing but marks', 'a.xyz', lambda: text(np.zeros((500, 3))).encode(), ('too few|mark', ), True),
    Case('all but few are marks', 'a.xyz', lambda: text(np.vstack([np.zeros((5000, 3)), surface()[:60]])).encode(), ('60 points are too few', MARK), True),
]  # fmt: skip

COMMA = surface()[:, :3]
TEXTS = [
    Case('columns z, y, x', 'a.csv', lambda: text(surface()[:, ::-1], ',', 'z,y,x').encode(), check=is_surface()),
    Case('names with units', 'a.csv', lambda: text(surface(), ';', 'X [mm];Y [mm];Z [mm]', True).encode(), ('decimal commas',), check=is_surface()),
    Case('intensity before x', 'a.txt', lambda: text(np.column_stack([np.full(N, 7), surface()]), '\t', 'Intensity\tX\tY\tZ').encode(), check=is_surface()),
    Case('normals and colours beside', 'a.xyz', lambda: text(np.hstack([surface()[:, [1]], surface()[:, [0]], np.ones((N, 6)), surface()[:, [2]]]), ' ', 'y x nx ny nz r g b z').encode(), check=is_surface()),
    Case('a header as a comment', 'a.txt', lambda: text(surface()[:, [2, 0, 1]], ' ', f'//Z X Y\n{N}').encode(), check=is_surface()),
    Case('comments', 'a.xyz', lambda: text(surface(), ' ', '# made here\n// of 1,5 points').encode(), check=is_surface()),
    Case('no x, y, z in the header', 'a.csv', lambda: text(surface(), ',', 'a,b,c').encode(), ('line 1', 'does not name x, y and z'), True),
    Case('x twice', 'a.csv', lambda: text(surface(), ',', 'x,x,z').encode(), ('x twice',), True),
    Case('the header says metres', 'a.csv', lambda: text(surface() / 1e3, ',', 'X [m],Y [m],Z [m]', form='%.7f').encode(), ('says m', '--scale 1'), True),
    Case('unit unknown', 'a.csv', lambda: text(surface(), ',', 'X [ft],Y [ft],Z [ft]').encode(), ('units of x, y and z',), True),
    Case('tabs and decimal commas', 'a.txt', lambda: text(surface(), '\t', '', True).encode(), ('decimal commas',), check=is_surface()),
    Case('blanks and decimal commas', 'a.xyz', lambda: text(surface(), ' ', '', True).encode(), ('decimal commas',), check=is_surface()),
    Case('semicolons', 'a.csv', lambda: text(surface(), ';').encode(), check=is_surface()),
    Case('commas and blanks', 'a.csv', lambda: text(surface(), ', ').encode(), check=is_surface()),
    Case('quoted decimal commas', 'a.csv', lambda: text(surface(), '","', '', True).replace('\n', '"\n"').encode().join([b'"', b''])[:-1], ('decimal commas',), check=is_surface()),
    Case('trailing separators', 'a.csv', lambda: text(surface(), ';', 'x;y;z;', end=';\n').replace('z;;', 'z;').encode(), check=is_surface()),
    Case('empty fields', 'a.csv', lambda: text(surface(), ';', 'x;y;z').replace('\n200.5000;', '\n;').encode(), ('61 points without a finite',), check=is_surface(N - 61)),
    Case('decimal or separating commas', 'a.csv', lambda: text(np.round(surface()), ',', '', form='%d,5').encode(), ('line 1', 'decimal commas'), True),
    Case('three names, six columns', 'a.csv', lambda: text(surface(), ',', 'x,y,z', True).encode(), ('line', 'comma|columns'), True),
    Case('thousands with points', 'a.csv', lambda: text(surface(), ';', 'x;y;z', True).replace('\n200,5', '\n1.200,5').encode(), ('line [0-9]+', 'thousands'), True),
    Case('thousands with commas', 'a.csv', lambda: text(surface(), ';', 'x;y;z').replace('\n200.5', '\n1,200.5').encode(), ('line [0-9]+', 'thousands'), True),
    Case('thousands with blanks', 'a.csv', lambda: text(surface(), ';', 'x;y;z', True).replace('\n200,5', '\n1 200,5').encode(), ('line [0-9]+', 'thousands'), True),
    Case('comma with three digits', 'a.csv', lambda: text(surface() + (0, 300, 100), ';', '', True, form='%.3f').encode(), ('decimal comma or a separator of thousands',), True),
    Case('a row too short', 'a.xyz', lambda: text(surface()).replace('\n200.5000', '\n', 1).encode(), ('line 2: 2 columns',), True),
    Case('cut off', 'a.xyz', lambda: text(surface()).encode()[:-12], (f'line {N}: 2 columns',), True),
    Case('a word', 'a.xyz', lambda: text(surface()).replace('\n200.5000', '\nhello', 1).encode(), ("line 2: 'hello' is no number",), True),
    Case('decimal commas and points', 'a.csv', lambda: text(surface(), ';', '', True).replace('\n200,5000', '\n200.5', 1).encode(), ('line 2', 'decimal point'), True),
    Case('a byte order mark', 'a.csv', lambda: text(surface(), ',', 'x,y,z').encode('utf-8-sig'), check=is_surface()),
    Case('UTF-16', 'a.csv', lambda: text(surface()[:, ::-1], ';', 'Z;Y;X').encode('utf-16'), check=is_surface()),
    Case('CR alone', 'a.xyz', lambda: text(surface(), end='\r').encode(), check=is_surface()),
    Case('too many announced', 'a.xyz', lambda: text(surface(), ' ', '9999').encode(), ('9999 points are announced',), True),
    Case('columns without names', 'a.xyz', lambda: text(np.hstack([surface(), surface()])).encode(), ('first 3 of 6',), check=is_surface()),
]  # fmt: skip

F4, F8 = '<f4', '<f8'
ARRAYS = [
    Case('PCD, text, z first', 'a.pcd', lambda: pcd_head('z intensity y x', '4 4 4 4', 'F F F F', 'ascii') + text(np.column_stack([surface()[:, 2], np.ones(N), surface()[:, 1], surface()[:, 0]])).encode(), check=is_surface()),
    Case('PCD with padding', 'a.pcd', lambda: pcd_head('x y z _ intensity', '4 4 4 1 4', 'F F F U F', 'binary') + records(('x', F4), ('y', F4), ('z', F4), ('p', 'u1'), ('i', F4)).tobytes(), check=is_surface()),
    Case('PCD of doubles', 'a.pcd', lambda: pcd_head('x y z', '8 8 8', 'F F F', 'binary') + surface().tobytes(), check=is_surface()),
    Case('PCD, compressed', 'a.pcd', compressed, check=same(lambda: np.round(surface() * 4) / 4)),
    Case('PCD, compressed, cut off', 'a.pcd', lambda: compressed(50), ('truncated',), True),
    Case('PCD with a viewpoint', 'a.pcd', lambda: pcd_head('x y z', '8 8 8', 'F F F', 'binary', more='1 2 3 1 0 0 0') + surface().tobytes(), ('VIEWPOINT',), check=is_surface()),
    Case('PCD, cut off', 'a.pcd', lambda: (pcd_head('x y z', '8 8 8', 'F F F', 'binary') + surface().tobytes())[:-9], ('truncated',), True),
    Case('PCD, text, cut off', 'a.pcd', lambda: pcd_head('x y z', '4 4 4', 'F F F', 'ascii') + text(surface()[:-3]).encode(), (f'{N} points are announced',), True),
    Case('PCD of 10^12 points', 'a.pcd', lambda: pcd_head('x y z', '4 4 4', 'F F F', 'binary', 10**12), ('announced',), True),
    Case('PCD without z', 'a.pcd', lambda: pcd_head('x y q', '4 4 4', 'F F F', 'binary', 0), ('z not',), True),
    Case('PCD, decimal commas', 'a.pcd', lambda: pcd_head('x y z', '4 4 4', 'F F F', 'ascii') + text(surface(), ' ', '', True).encode(), ('decimal commas',), True),
    Case('PLY, text', 'a.ply', lambda: ply('float x, float y, float z, uchar red', text(np.column_stack([surface(), np.ones(N)])).encode(), 'ascii'), check=is_surface()),
    Case('PLY, doubles, the large end first', 'a.ply', lambda: ply('double z, double y, double x', surface()[:, ::-1].astype('>f8').tobytes(), 'binary_big_endian'), check=is_surface()),
    Case('PLY with more properties', 'a.ply', lambda: ply('float x, float y, float z, uchar q, float scalar_intensity', records(('x', F4), ('y', F4), ('z', F4), ('q', 'u1'), ('i', F4)).tobytes(), 'binary_little_endian'), check=is_surface()),
    Case('PLY of 10^12 points', 'a.ply', lambda: ply('float x, float y, float z', b'', 'binary_little_endian', 10**12), ('announced',), True),
    Case('PLY without y', 'a.ply', lambda: ply('float x, float z', bytes(8 * N), 'binary_little_endian'), ('y is needed',), True),
    Case('whole numbers in an organised array', 'a.npy', lambda: organised(-32768, np.int16), (MARK,), check=is_surface(N - len(some(3)), 16.0)),
    Case('records', 'a.npy', lambda: npy(records(('z', F8), ('i', F4), ('x', F8), ('y', F8))), check=is_surface()),
    Case('points in columns', 'a.npy', lambda: npy(surface().T), (r'shape \(3, 7381\)',), True),
    Case('a picture', 'a.npy', lambda: npy(np.zeros((480, 640))), (r'shape \(480, 640\)',), True),
    Case('Python objects', 'a.npy', lambda: npy(np.array([{}] * 200, object)), ('objects',), True),
    Case('an array of 10^12', 'a.npy', lambda: npy(np.zeros((1, 3))).replace(b'(1, 3), }  ', b'(10**12,3)}')[:128].replace(b'(10**12,3)}', b'(9**9, 3)} '), ('NumPy|announced',), True),
    Case('an archive with points', 'a.npz', lambda: npz(points=surface(), colours=np.ones((N, 3))), check=is_surface()),
    Case('an archive with x, y, z', 'a.npz', lambda: npz(**{a: v.reshape(ROWS, COLUMNS) for a, v in zip('xyz', surface().T, strict=True)}), check=is_surface()),
    Case('an archive of others', 'a.npz', lambda: npz(a=surface(), b=surface()), ('none of its arrays',), True),
]  # fmt: skip

UNITS = [
    Case('metres', 'a.xyz', lambda: text(surface() / 1e3, form='%.7f').encode(), ('wrong units', r'--scale 1 \(m\)'), True),
    Case('inches', 'a.xyz', lambda: text(surface() / 25.4, form='%.6f').encode(), ('wrong units', 'inch'), True),
    Case('micrometres', 'a.npy', lambda: npy(surface() * 1e3), ('wrong units', 'um'), True),
    Case('a scan in inches of a part in mm', 'a.npy', lambda: npy((surface(0) - (200, -50, 0)) * 10 / 25.4), ('wrong units', 'inch and mm'), True, part=lambda: box((600, 300, 200))),
    Case('a scan in metres of a part in mm', 'a.npy', lambda: npy((surface(0) - (200, -50, 0)) / 1e2), ('wrong units',), True, part=lambda: box((600, 300, 200))),
    Case('a worn mesh in inches of a part in mm', 'a.stl', lambda: box((600 / 25.4, 300 / 25.4, 7)), ('wrong units', 'inch and mm'), True, part=lambda: box((600, 300, 200))),
    Case('a scan with marks of a part', 'a.npy', lambda: npy(marked((0, 0, 0)) - (200, -50, 0)), (MARK,), part=box),
]  # fmt: skip
CASES = [*MARKS, *TEXTS, *ARRAYS, *UNITS]
