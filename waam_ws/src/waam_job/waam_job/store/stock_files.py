"""For whoever machines the part: the stock to remove cell by cell (CSV), and the surface as laid (STL, mm)."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from waam_node import job_folder
from waam_plan.mesh.stl import stl_of
from waam_plan.plan import Plan

from ..model.stock import needed_area


def write(folder: Path, plan: Plan, z: np.ndarray) -> None:
    """z: (rows, cols) m, the surface after the last layer, NaN = not seen; plan: that of the first pass.

    One row per cell of the needed area and of what was laid: x_mm, y_mm, stock_mm (below 0: metal is missing; empty:
    not seen), needed (0/1).
    """
    needed, over = needed_area(plan), z - plan.nominal.z
    with open(folder / job_folder.STOCK_MAP, 'w', newline='') as f:
        out = csv.writer(f)
        out.writerow(['x_mm', 'y_mm', 'stock_mm', 'needed'])
        for row, col in zip(*np.nonzero(needed | plan.region), strict=True):
            stock = over[row, col] * 1e3
            said = f'{stock:.4f}' if np.isfinite(stock) else ''
            x, y = plan.spec.x[col] * 1e3, plan.spec.y[row] * 1e3
            out.writerow([f'{x:.3f}', f'{y:.3f}', said, int(needed[row, col])])
    (folder / job_folder.AS_LAID).write_bytes(stl_of(plan.spec.x * 1e3, plan.spec.y * 1e3, z * 1e3))
