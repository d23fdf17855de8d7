"""The points of a `sensor_msgs/PointCloud2` as arrays, whatever its layout: any field order, padding and byte order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEAREST = 1e-3  # m
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
    """x, z (rows, points) float32 m, scanner frame with z up.

    down: z in the cloud is the distance from the sensor, as the scanCONTROL drivers have it; points nearer than
    NEAREST are no returns (drivers mark them with infinity, or not at all: z = 0). Every row is a profile.
    """
    found = read_fields(layout, data, ('x', 'z'))
    missing = [n for n in ('x', 'z') if n not in found]
    if missing:
        have = ', '.join(f[0] for f in layout.fields) or 'none'
        raise ValueError(f'the cloud has no field {" and ".join(missing)} (it has {have})')
    x, z = (np.ascontiguousarray(found[n], np.float32) for n in ('x', 'z'))
    if down:
        z = np.where(z >= np.float32(NEAREST), -z, np.float32(np.nan))
    return x, z
