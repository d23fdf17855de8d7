"""The points of a `sensor_msgs/PointCloud2` as arrays, whatever its layout: any field order, padding and byte order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEAREST = 1e-3  # m
MAX_Y = 1e-5  # m, beside the plane of the profile
# sensor_msgs/PointField datatype -> numpy
DATATYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}


@dataclass(frozen=True)
class CloudLayout:
    """How points lie in the bytes of a PointCloud2."""

    # name, offset, datatype, count, as in the message
    fields: tuple[tuple[str, int, int, int], ...]
    width: int
    height: int
    step: int  # bytes per point
    row_step: int  # bytes per row
    big_endian: bool = False

    def dtype(self, names: tuple[str, ...]) -> np.dtype:
        """Of the fields `names` that are there; ValueError for a field that reaches over the point."""
        order, chosen = '>' if self.big_endian else '<', {}
        for name, offset, datatype, count in self.fields:
            if name not in names:
                continue
            if datatype not in DATATYPES:
                raise ValueError(f'field {name} has the unknown datatype {datatype}')
            kind = np.dtype(order + DATATYPES[datatype])
            if count not in (0, 1) or offset + kind.itemsize > self.step:
                raise ValueError(
                    f'field {name} ({count} values at byte {offset}) does not fit into a point of {self.step} bytes'
                )
            chosen[name] = (kind, offset)
        return np.dtype(
            {
                'names': list(chosen),
                'formats': [k for k, _ in chosen.values()],
                'offsets': [o for _, o in chosen.values()],
                'itemsize': self.step,
            }
        )


def read_fields(layout: CloudLayout, data: bytes, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """The fields `names` that the cloud has, each (height, width) in its own type; ValueError when bytes are
    missing."""
    h, w = layout.height, layout.width
    if h < 1 or w < 1 or layout.step < 1:
        raise ValueError(f'{h} rows of {w} points of {layout.step} bytes is an empty cloud')
    row = layout.row_step or w * layout.step
    if row < w * layout.step:
        raise ValueError(f'row_step {row} is less than {w} points of {layout.step} bytes')
    need = (h - 1) * row + w * layout.step
    if len(data) < need:
        raise ValueError(f'{len(data)} bytes of data, {h} x {w} points need {need}')
    dtype = layout.dtype(names)
    points = np.ndarray((h, w), dtype, data, strides=(row, layout.step))
    return {name: points[name] for name in dtype.names or ()}


def profiles_of(layout: CloudLayout, data: bytes, down: bool) -> tuple[np.ndarray, np.ndarray]:
    """x, z (rows, points) float32 m, scanner frame with z up; ValueError for points beside the plane y = 0.

    down: z in the cloud is the distance from the sensor, as the scanCONTROL drivers have it; points nearer than
    NEAREST are no returns (drivers mark them with infinity, or not at all: z = 0). Every row is a profile.
    """
    found = read_fields(layout, data, ('x', 'y', 'z'))
    missing = [n for n in ('x', 'z') if n not in found]
    if missing:
        have = ', '.join(f[0] for f in layout.fields) or 'none'
        raise ValueError(f'the cloud has no field {" and ".join(missing)} (it has {have})')
    x, z = (np.ascontiguousarray(found[n], np.float32) for n in ('x', 'z'))
    if down:
        z = np.where(z >= np.float32(NEAREST), -z, np.float32(np.nan))
    if 'y' in found:
        beside = np.abs(found['y'][np.isfinite(x) & np.isfinite(z)].astype(float)).max(initial=0.0)
        if not beside <= MAX_Y:
            raise ValueError(
                f'a point has |y| = {beside * 1e3:.3f} mm: a profile lies in the plane y = 0 of its frame'
            )
    return x, z


def profile_of_rays(
    ranges: np.ndarray, first: float, step: float, nearest: float, farthest: float
) -> tuple[np.ndarray, np.ndarray]:
    """x, z (1, rays) float32 m, scanner frame with z up, of ranges (rays,) m in the plane x, y of a laser's own frame:
    its x axis points down, its y axis along x of the scanner.

    first, step: rad, angle of the first ray about the laser's z axis and between rays. Ranges that are not within
    nearest .. farthest, m, are no returns. ValueError says what cannot be.
    """
    n = len(ranges)
    last = first + step * (n - 1)
    if n == 0:
        raise ValueError('the scan has no ranges')
    around = abs(last - first) > 2 * np.pi + abs(step)
    if not np.isfinite(last) or around or (step == 0 and n > 1):
        raise ValueError(f'{n} rays from {first:.4g} rad, {step:.4g} rad apart, are no scan')
    if not 0 <= nearest < farthest:
        raise ValueError(
            f'no range lies between range_min {nearest:.4g} m and range_max {farthest:.4g} m'
        )
    r = np.asarray(ranges, float)
    seen = (r >= max(nearest, NEAREST)) & (r <= farthest) & np.isfinite(r)
    r = np.where(seen, r, np.nan)
    angles = first + step * np.arange(n)
    x, z = r * np.sin(angles), -r * np.cos(angles)
    return x[None].astype(np.float32), z[None].astype(np.float32)
