"""What verbs that need no graph take from the cell file: reach of `waam plan`, parameters of `waam lab`, the wire."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from waam_process.cell_keys import AXES, MATERIAL, PLATE, WORK_ZERO
from waam_process.operating import DEFAULT_MATERIAL
from waam_shop.cells import check_name

from .paths import cell_name, cells_dir

if TYPE_CHECKING:
    from waam_process.cell_file import CellFile


def _file(given: str) -> CellFile | None:
    """Of this cell, '' = the one that is meant, which may have none. ValueError for a wrong one, and for a name
    without a file."""
    name = check_name(given) if given else cell_name()
    path = cells_dir() / f'{name}.yaml'
    if (
        given or path.exists()
    ):  # without one, parameters of nodes are not loaded: that takes a second
        from .cell_check import load

        return load(path)
    return None


def reach(name: str, build: bool) -> tuple[dict[str, Any], str]:
    """Settings of the planner, and the file that says so; ({}, '') where there is none. name: '' = the cell that is
    meant. ValueError for a wrong file and for one that does not say all of it."""
    from waam_process.cell_file import CellError

    cell = _file(name)
    if cell is None:
        return {}, ''
    box = cell.box(build)
    if box is None:
        needed = (
            *(f'{AXES}{axis}.envelope_mm' for axis in 'xyz'),
            WORK_ZERO,
            *((PLATE,) if build else ()),
        )
        missing = [path for path in needed if path not in cell.values]
        raise CellError(f'{cell.name}: {", ".join(missing)}: needed for a plan')
    return {'machine_min': box[0], 'machine_max': box[1]}, cell.name


def laboratory(name: str) -> tuple[dict[str, dict[str, Any]], str, str]:
    """Parameters by node, the wire ('' = not said) and the file; ({}, '', '') where there is none. ValueError."""
    cell = _file(name)
    if cell is None:
        return {}, '', ''
    return cell.parameters(simulated=True), str(cell.values.get(MATERIAL, '')), cell.name


def material(given: str) -> str:
    """Of the command line, of the cell file, or the usual one. ValueError for a wrong file."""
    cell = None if given else _file('')
    return given or (str(cell.values.get(MATERIAL, '')) if cell else '') or DEFAULT_MATERIAL
