"""Clouds made here, written in all their forms, and what must come back."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable

import numpy as np
import trimesh
from reader_case import GotCloud

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
    points: np.ndarray,
    delimiter: str = ' ',
    head: str = '',
    comma: bool = False,
    end: str = '\n',
    form: str = '%.4f',
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


def pcd_head(
    fields: str, size: str, kind: str, data: str, count: int | None = None, more: str = ''
) -> bytes:
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
    return (
        f'ply\nformat {form} 1.0\ncomment made here\nelement vertex {count}\n{properties}end_header\n'.encode()
        + data
    )


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
