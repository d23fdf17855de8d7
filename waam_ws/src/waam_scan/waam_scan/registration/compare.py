"""The metal that is missing between a scan and the nominal surface, seen from above: the restoration volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_process.grid import GridSpec, HeightGrid

MARGIN_CELLS = 4  # around the part
REAL = 3.0  # standard uncertainties from which a depth is more than chance
MIN_DEPTH = 0.1e-3  # m, and at least this deep: creases of the nominal part come out this round
MIN_REGION_CELLS = 4  # cells of a region that is worth naming


@dataclass(frozen=True)
class Region:
    """One connected place with missing metal."""

    volume: float  # m3
    area: float  # m²
    deepest: float  # m
    at: tuple[float, float]  # (x, y) m, of the deepest place
    box: tuple[float, float, float, float]  # (x_min, x_max, y_min, y_max) m


@dataclass(frozen=True)
class Missing:
    """Missing metal between nominal and found. Lengths in m, coordinates of the nominal part."""

    nominal: HeightGrid
    found: HeightGrid
    # (rows, cols) nominal + allowance - found; negative = too much, NaN = not seen or off the part
    depth: np.ndarray
    sigma: np.ndarray  # (rows, cols) standard uncertainty of depth
    allowance: float  # metal left for machining
    volume: float  # m3 to add
    volume_sigma: float  # m3, its standard uncertainty
    excess: float  # m3 to take away
    deepest: float  # median of 3 x 3 cells
    box: tuple[float, ...] | None  # (x_min, x_max, y_min, y_max, z_min, z_max) of the missing metal
    unseen: float  # share of the part that the scan does not show
    regions: list[Region]

    @property
    def spec(self) -> GridSpec:
        """The cells of all maps."""
        return self.nominal.spec


def nominal_grid(triangles: np.ndarray, cell: float) -> HeightGrid:
    """Highest z of the mesh (n, 3, 3) m over every cell centre, by rays from above; NaN off the part."""
    low, high = triangles.reshape(-1, 3).min(axis=0), triangles.reshape(-1, 3).max(axis=0)
    margin = MARGIN_CELLS * cell
    spec = GridSpec.covering(
        low[0] - margin, low[1] - margin, high[0] + margin, high[1] + margin, cell
    )
    return HeightGrid(spec, top_heights(triangles, spec))


def top_heights(triangles: np.ndarray, spec: GridSpec) -> np.ndarray:
    """(rows, cols) m; Open3D's ray casting."""
    import open3d as o3d

    flat = triangles.reshape(-1, 3)
    low, high = flat.min(axis=0), flat.max(axis=0)
    start = 1e3 * (high[2] - low[2]) + 10.0
    scene = o3d.t.geometry.RaycastingScene(nthreads=2)
    scene.add_triangles(
        o3d.core.Tensor(((flat - low) * 1e3).astype(np.float32)),
        o3d.core.Tensor(np.arange(len(flat), dtype=np.uint32).reshape(-1, 3)),
    )
    x, y = np.meshgrid((spec.x - low[0]) * 1e3, (spec.y - low[1]) * 1e3)
    rays = np.zeros((*x.shape, 6), np.float32)
    rays[..., 0], rays[..., 1], rays[..., 2], rays[..., 5] = x, y, start, -1.0
    reach = scene.cast_rays(o3d.core.Tensor(rays))['t_hit'].numpy().astype(float)
    return np.where(np.isfinite(reach), (start - reach) * 1e-3 + low[2], np.nan)


def found_grid(points: np.ndarray, spec: GridSpec) -> HeightGrid:
    """Robust height per cell of points (n, 3) m in the coordinates of the grid, with the fusion of the scans."""
    from ..fusion.height_map import Fusion
    from ..fusion.limits import FusionLimits
    from ..transform import Mounting

    z = points[:, 2]
    low, high = float(z.min()), float(z.max())
    limits = FusionLimits(
        height_min=low - 1e-3, height_max=high + 1e-3, support=2 * spec.resolution
    )
    fusion = Fusion(spec, Mounting(np.zeros(3), np.eye(3)), limits)
    tcp = np.column_stack([points[:, :2], np.zeros(len(points))])
    fusion.add(tcp, np.zeros((len(points), 1)), z[:, None])
    fused = fusion.result()
    return HeightGrid(spec, fused.z.astype(float), fused.sigma.astype(float))


def missing_metal(
    nominal: HeightGrid, found: HeightGrid, allowance: float = 0.0, level_sigma: float = 0.0
) -> Missing:
    """Compares two grids of the same geometry.

    allowance: m of metal on top of nominal that machining takes off again; level_sigma: m, standard uncertainty of the
    height that all cells share (registration, zero). ValueError when the grids differ or never meet.
    """
    if nominal.spec != found.spec:
        raise ValueError(f'nominal lies on {nominal.spec}, the scan on {found.spec}')
    part = np.isfinite(nominal.z)
    seen = part & np.isfinite(found.z)
    if seen.sum() < 10:
        raise ValueError(
            'the scan and the nominal part do not overlap from above: other coordinates? (--register --search)'
        )
    depth = np.where(seen, nominal.z + allowance - found.z, np.nan)
    own = found.sigma if found.sigma is not None else np.zeros(found.z.shape)
    sigma = np.where(seen, np.nan_to_num(own), np.nan)
    cell = nominal.spec.resolution**2
    less = seen & (np.nan_to_num(depth) > np.maximum(REAL * np.nan_to_num(sigma), MIN_DEPTH))
    volume = float(depth[less].sum()) * cell
    chance = float(np.sqrt(np.square(sigma[less]).sum())) * cell
    shared = level_sigma * float(less.sum()) * cell
    more = seen & (np.nan_to_num(depth) < -np.maximum(REAL * np.nan_to_num(sigma), MIN_DEPTH))
    calm = _median3(depth)
    return Missing(
        nominal=nominal,
        found=found,
        depth=depth,
        sigma=sigma,
        allowance=allowance,
        volume=volume,
        volume_sigma=float(np.hypot(chance, shared)),
        excess=-float(depth[more].sum()) * cell,
        deepest=float(np.nanmax(np.where(less, calm, np.nan))) if less.any() else 0.0,
        box=_box(nominal, found, less, allowance),
        unseen=float((part & ~seen).sum() / part.sum()),
        regions=_regions(nominal.spec, calm, depth, less),
    )


def _median3(depth: np.ndarray) -> np.ndarray:
    """Median of the known cells of every 3 x 3 neighbourhood; NaN stays."""
    import warnings

    padded = np.pad(depth, 1, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)  # neighbourhoods without a known cell
        calm = np.nanmedian(windows, axis=(2, 3))
    return np.where(np.isfinite(depth), calm, np.nan)


def _box(
    nominal: HeightGrid, found: HeightGrid, less: np.ndarray, allowance: float
) -> tuple[float, ...] | None:
    if not less.any():
        return None
    x0, x1, y0, y1 = _outline(nominal.spec, less)
    top = float((nominal.z[less] + allowance).max())
    return x0, x1, y0, y1, float(found.z[less].min()), top


def _outline(spec: GridSpec, cells: np.ndarray) -> tuple[float, float, float, float]:
    rows, cols = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
    half = 0.5 * spec.resolution
    return (
        float(spec.x[cols[0]] - half),
        float(spec.x[cols[-1]] + half),
        float(spec.y[rows[0]] - half),
        float(spec.y[rows[-1]] + half),
    )


def _regions(spec: GridSpec, calm: np.ndarray, depth: np.ndarray, less: np.ndarray) -> list[Region]:
    """Connected places of at least MIN_REGION_CELLS cells, the largest volume first."""
    from scipy import ndimage

    label, count = ndimage.label(less, np.ones((3, 3)))
    found = []
    for i, window in enumerate(ndimage.find_objects(label), 1):
        cells = np.zeros(less.shape, bool)
        cells[window] = label[window] == i
        if cells.sum() < MIN_REGION_CELLS:
            continue
        deep = np.where(cells, calm, -np.inf)
        row, col = np.unravel_index(int(np.nanargmax(deep)), deep.shape)
        found.append(
            Region(
                volume=float(depth[cells].sum()) * spec.resolution**2,
                area=float(cells.sum()) * spec.resolution**2,
                deepest=float(deep[row, col]),
                at=(float(spec.x[col]), float(spec.y[row])),
                box=_outline(spec, cells),
            )
        )
    return sorted(found, key=lambda r: -r.volume)
