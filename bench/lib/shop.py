"""Parts that a repair shop gets, as nominal and worn meshes (mm): twelve to choose on, twelve to report on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from . import shop_choosing, shop_reporting
from .shop_shapes import Worn

KINDS = {'choosing': shop_choosing.KINDS, 'reporting': shop_reporting.KINDS}
ALL = {**shop_choosing.KINDS, **shop_reporting.KINDS}


def write(folder: Path, kind: str) -> tuple[Path, Path]:
    """Nominal and worn part as STL."""
    from waam_lab.parts import body

    part: Worn = ALL[kind]()
    paths = tuple(folder / f'{kind}_{name}.stl' for name in ('nominal', 'worn'))
    tops = (part.nominal, part.nominal - np.maximum(part.wear, 0))
    for path, top in zip(paths, tops, strict=True):
        body(part.plan, part.kept, top).export(path)
    return paths
