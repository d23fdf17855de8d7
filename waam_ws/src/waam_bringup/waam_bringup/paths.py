"""Where things are: shares of packages, the folder of the running graph, the folder of the jobs."""

from __future__ import annotations

import os
from pathlib import Path

from waam_shop.cells import FIRST, check_name

CELL = 'WAAM_CELL'  # variable of the environment: name of the cell that is meant


def share(package: str) -> Path:
    """<prefix>/share/<package> from AMENT_PREFIX_PATH."""
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(':'):
        candidate = Path(prefix) / 'share' / package
        if prefix and candidate.is_dir():
            return candidate
    raise FileNotFoundError(f'package {package} is not in AMENT_PREFIX_PATH (source the workspace)')


def root() -> Path:
    """The working tree (WAAM_ROOT from env.sh), or the current folder on a full ROS installation."""
    return Path(os.environ.get('WAAM_ROOT', '.')).resolve()


def cell_name() -> str:
    """Name of the cell that is meant: WAAM_CELL, or that of the first cell. ValueError for a name that is none."""
    return check_name(os.environ.get(CELL) or FIRST)


def shop_jobs_dir() -> Path:
    """Folder of the jobs of the first cell, which holds those of all others: WAAM_JOBS, or `jobs` in the tree."""
    return Path(os.environ.get('WAAM_JOBS', root() / 'jobs')).resolve()


def jobs_dir(cell: str = '') -> Path:
    """Folder of the jobs of a cell ('' = the one that is meant); of a named one `cells/<name>` below that of the first.
    ValueError for a name that is none."""
    return _of_cell(shop_jobs_dir(), cell)


def shop_dir() -> Path:
    """What all cells share (queues, tokens, logs): WAAM_SHOP, or `.shop` in the folder of the jobs."""
    return Path(os.environ.get('WAAM_SHOP', shop_jobs_dir() / '.shop')).resolve()


def calibrations_dir() -> Path:
    """Folder of calibration results: WAAM_CALIBRATIONS, or `calibrations` in the working tree; of each cell its own."""
    return _of_cell(Path(os.environ.get('WAAM_CALIBRATIONS', root() / 'calibrations')).resolve())


def scanner_calibration() -> Path:
    """Of the scanner, as `waam commission` keeps it for the cell; `waam up` takes it where the cell file names none."""
    return calibrations_dir() / 'commission' / 'scanner.yaml'


def cells_dir() -> Path:
    """Folder of the cell files of the user: WAAM_CELLS, or `cells` in the working tree."""
    return Path(os.environ.get('WAAM_CELLS', root() / 'cells')).resolve()


def run_dir() -> Path:
    """Folder of the running graph: sockets, logs, state. One graph per folder."""
    default = jobs_dir() / '.run'
    return Path(os.environ.get('WAAM_RUN', default)).resolve()


def _of_cell(folder: Path, cell: str = '') -> Path:
    name = check_name(cell) if cell else cell_name()
    return folder if name == FIRST else folder / 'cells' / name
