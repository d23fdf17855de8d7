"""What the verbs of a shop need of the panel and of the folders: they meet here and nowhere else."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from waam_shop.shop_folder import Places, Shop

from . import run_state
from .paths import CELL, cell_name, jobs_dir, run_dir, share, shop_dir


def places() -> Places:
    """For `waam_shop.cli.register`."""
    return Places(shop_dir, cell_name, store_part, check_setup, is_program)


@contextmanager
def cell(name: str) -> Iterator[None]:
    """Folders inside the block are those of this cell."""
    before = os.environ.get(CELL)
    os.environ[CELL] = name
    try:
        yield
    finally:
        os.environ.pop(CELL) if before is None else os.environ.update({CELL: before})


def store_part(name: str, file: Path) -> str:
    """Copies mesh or program to where uploads of the panel of a cell go, unless it is there. Returns its name.
    ValueError."""
    from waam_panel.parts import PartFolders
    from waam_panel.programs import Programs

    with cell(name):
        folders = PartFolders((jobs_dir() / 'parts', share('waam_bringup') / 'parts'))
    kind = Programs(folders).files if is_program(file) else folders
    return kind.save(file.name, file.read_bytes())


def is_program(file: Path) -> bool:
    """Whether a file is G-code of another slicer, and not a mesh."""
    from waam_panel.programs import SUFFIXES

    return file.suffix.lower() in SUFFIXES


def check_setup(setup: dict[str, Any]) -> dict[str, Any]:
    """A setup as the forms of the panel take it, all fields filled in. ValueError that names what is wrong."""
    from waam_panel.queued import fields_of
    from waam_process.materials import load

    return fields_of(setup, tuple(load()))


def domain_of(run: Path, wanted: int) -> int:
    """The wanted ROS_DOMAIN_ID, or the next one that no other cell of the shop has while it is up."""
    taken = {s.domain for s in _others(run) if s.alive}
    return next(d for d in (1 + (wanted - 1 + n) % 99 for n in range(99)) if d not in taken)


def _others(run: Path) -> Iterator[run_state.RunState]:
    for name in Shop(shop_dir()).names():
        with cell(name):
            other = run_dir()
        state = run_state.load(other) if other != run else None
        if state:
            yield state
