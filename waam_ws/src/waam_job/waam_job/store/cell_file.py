"""The cell file as the job sees it: whether the machine is what it says, and the copy that the job keeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from waam_node import job_folder
from waam_process.cell_file import LIMIT, CellError, CellFile, parse
from waam_process.cell_keys import MACHINE
from waam_process.safe_files import FileError, read_text

from .folder import JobFolder


@dataclass(frozen=True)
class Compared:
    """refused: why no job may start; remarks: what a person should know."""

    refused: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def read(file: str) -> CellFile:
    """CellError when it cannot be read."""
    try:
        return parse(read_text(Path(file), limit=LIMIT), file)
    except FileError as e:
        raise CellError(str(e)) from None


def compared(file: str, parameters: Mapping[str, Mapping[str, Any]], simulated: bool) -> Compared:
    """file: '' = the cell has none; parameters: those that the nodes have. The bridge compares its own with what the
    controller has before anything homes or is armed; here they are compared with the file as it is now."""
    if not file:
        return Compared()
    try:
        cell = read(file)
    except CellError as e:
        return Compared((f'cell file: {e}',))
    if 'bridge' not in parameters:
        return Compared(
            (f'cell file: the bridge did not say what it has told the controller ({file})',)
        )
    off = cell.differences(parameters, simulated)
    again = (
        'waam stop, waam up: the cell file was changed since, or a parameter file contradicts it'
    )
    machine = [text for path, text in off.items() if path.startswith(MACHINE)]
    refused = (f'{"; ".join(machine)} ({again})',) if machine else ()
    return Compared(
        refused, tuple(text for path, text in off.items() if not path.startswith(MACHINE))
    )


def keep(folder: JobFolder, file: str, run: int = 1) -> dict[str, str]:
    """Copies the file into the folder of the job, for this run of it. For job.yaml: which file it was, its hash,
    and that of what the controller is told, or why there is no copy."""
    try:
        cell = read(file)
    except CellError as e:
        return {'file': file, 'trouble': str(e)}
    folder.keep(job_folder.cell(run), cell.text)
    return {'file': file, 'sha256': cell.sha256, 'machine_sha256': cell.machine_sha256}
