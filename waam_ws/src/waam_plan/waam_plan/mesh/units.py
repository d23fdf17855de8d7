"""Whether the unit of a file can be right, by how large what it holds would be."""

from __future__ import annotations

from pathlib import Path

import numpy as np

MIN_SIZE, MAX_SIZE = 5e-3, 2.0  # m, plausible size of a part or a scan; a bead is 3 to 8 mm wide
UNITS = {'m': 1.0, 'mm': 1e-3, 'cm': 1e-2, 'inch': 0.0254, 'um': 1e-6}
SIZE_TOLERANCE = 0.15  # share by which two sizes may differ and still be one
FACTORS = {
    1000.0: 'm and mm, or mm and um',
    25.4: 'inch and mm',
    10.0: 'cm and mm',
    1e6: 'm and um',
}
FACTORS |= {
    1 / 0.0254: 'm and inch',
    2.54: 'inch and cm',
    100.0: 'm and cm',
    25400.0: 'inch and um',
}


def wrong_size(size: float, scale: float, what: str) -> str:
    """What is wrong with a `what` that measures `size` (m) at `scale` (m per unit), with the remedy; '' if nothing."""
    if MIN_SIZE <= size <= MAX_SIZE:
        return ''
    fits = [
        f'--scale {value:g} ({unit})'
        for unit, value in UNITS.items()
        if 2 * MIN_SIZE <= size / scale * value <= MAX_SIZE and value != scale
    ]
    hint = f'{" or ".join(fits)} would fit' if fits else 'no usual unit fits, check the export'
    return (
        f'wrong units? With scale {scale:g} m per unit the {what} is {size * 1e3:.4g} mm large '
        f'(accepted {MIN_SIZE * 1e3:g} to {MAX_SIZE * 1e3:g} mm); {hint}'
    )


def wrong_ratio(found: np.ndarray, part: np.ndarray, path: Path) -> str:
    """What is wrong where a scan is as many times smaller or larger than the part as two units differ; '' if nothing.

    found, part: (2,) m, size along x and y.
    """
    if not ((found > 0).all() and (part > 0).all()):
        return ''
    ratio = part / found
    for factor, units in FACTORS.items():
        for f, word in ((factor, 'smaller'), (1 / factor, 'larger')):
            if (np.abs(ratio / f - 1) < SIZE_TOLERANCE).all():
                return (
                    f'{path}: wrong units? It is {factor:.4g} times {word} than the part in x and y, as {units} do; '
                    'save both files in one unit (--scale counts for both)'
                )
    return ''
