"""tolerance_map.csv: the final surface against the wanted one, one grid cell a row, for whoever inspects the part."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from waam_node import job_folder
from waam_process.grid import GridSpec


def write(
    folder: Path,
    spec: GridSpec,
    error: np.ndarray,
    *,
    region: np.ndarray,
    interior: np.ndarray,
    tolerance: float,
) -> dict:
    """Writes x_mm, y_mm, deviation_mm (empty = not seen), judged (0/1) of every grid cell of the region.

    error (rows, cols) m, surface minus wanted; tolerance m. Returns the counts of judged grid cells for report.json.
    """
    rows, cols = np.nonzero(region)
    x = (spec.origin_x + (cols + 0.5) * spec.resolution) * 1e3
    y = (spec.origin_y + (rows + 0.5) * spec.resolution) * 1e3
    z, judged = error[region] * 1e3, interior[region]
    with open(folder / job_folder.TOLERANCE_MAP, 'w', newline='') as f:
        out = csv.writer(f)
        out.writerow(['x_mm', 'y_mm', 'deviation_mm', 'judged'])
        for a, b, c, d in zip(x, y, z, judged, strict=True):
            out.writerow([f'{a:.3f}', f'{b:.3f}', f'{c:.4f}' if np.isfinite(c) else '', int(d)])
    inner = error[interior]
    return {
        'file': job_folder.TOLERANCE_MAP,
        'cell_mm': spec.resolution * 1e3,
        'cells': int(interior.sum()),
        'in_tolerance': int((np.abs(inner) <= tolerance).sum()),
        'above': int((inner > tolerance).sum()),
        'below': int((inner < -tolerance).sum()),
        'unseen': int(np.isnan(inner).sum()),
    }
