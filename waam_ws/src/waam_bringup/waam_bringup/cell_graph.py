"""What the cell file says becomes the settings of a graph: one parameter file before those of the user, port,
pyrometer. What a user's file says against it is named."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from waam_node.files import write_atomically
from waam_process.cell_file import CellFile, alike
from waam_process.cell_keys import CHUCK, MACHINE, PORT, PYROMETER
from waam_process.operating import GANTRY, ROBOT

from . import cell_check
from .graph import GraphError, Settings, told_to
from .paths import cell_name, scanner_calibration

PARAMETERS = 'cell_params.yaml'  # in the folder of the graph
PLACES = {'calibration', 'mount_xyz', 'mount_rpy', 'profile_delay'}  # of scan_fusion
HEAD = '# Made of {} by waam up; the next one writes it anew. Change the cell file.\n'


@dataclass(frozen=True)
class Applied:
    """settings: of the graph; said: what a person should know, one line each."""

    settings: Settings
    said: tuple[str, ...]


def apply(settings: Settings, simulated: bool) -> Applied:
    """settings: of the command line; simulated: it says that no machine is to be used. CellError for a wrong file,
    GraphError where a parameter file contradicts what the controller is told, or the machine is another one."""
    path = cell_check.path_of(cell_name())
    cell = cell_check.find(cell_name())
    if cell is None:
        none = f'cell file: none ({cell_check.shown(path)}: waam cell new)'
        return Applied(settings, () if settings.machine == ROBOT else (none,))
    if settings.machine == ROBOT:
        raise GraphError(
            f'{cell.name} describes a {GANTRY}; a robot has parameters (waam_robot_bridge/README.md): use another '
            'name for its cell (--cell NAME)'
        )
    said: list[str] = []
    if not simulated:
        settings, said = _real(settings, cell)
    file = settings.run / PARAMETERS
    if CHUCK in cell.values and not settings.simulated:
        raise GraphError(
            f'{cell.where(CHUCK)}: a chuck of a real machine is not built (docs/real_cell.md); without a port, or with '
            '--simulated, the cell is simulated'
        )
    said += _against(cell, settings)
    settings.run.mkdir(parents=True, exist_ok=True)
    scanner = _scanner(settings, cell)
    said += [f'scanner: as commissioned ({cell_check.shown(scanner)})'] if scanner else []
    text = parameter_text(cell, settings.simulated, path, scanner)
    write_atomically(file, HEAD.format(cell.name) + text)
    told = replace(settings, params_files=(file, *settings.params_files))
    part = ': axes, process, work' if settings.simulated else ''
    return Applied(told, (f'cell file: {cell.name}{part}', *said))


def _scanner(settings: Settings, cell: CellFile) -> Path | None:
    """The calibration that `waam commission` has made, unless cell file or parameter files say where the scanner
    sits. That of a simulated cell sits elsewhere than that of the real one."""
    file, own = scanner_calibration(), told_to('scan_fusion', settings)
    if settings.simulated and cell.values.get(PORT):
        return None
    said = any(p in cell.values for p in (cell_check.CALIBRATION, *cell_check.MOUNTING))
    return file if file.is_file() and not said and not own.keys() & PLACES else None


def parameter_text(
    cell: CellFile, simulated: bool, path: Path | None = None, scanner: Path | None = None
) -> str:
    """A ROS parameter file. path: of the cell file, which every job then looks at before it starts; scanner: of its
    calibration."""
    values = cell.parameters(simulated)
    if scanner is not None:
        values.setdefault('scan_fusion', {})['calibration'] = str(scanner)
    if path is not None:
        values.setdefault('job_sequencer', {})['cell_file'] = str(path)
    blocks = {f'/**/{node}': {'ros__parameters': told} for node, told in values.items()}
    return yaml.safe_dump(blocks, sort_keys=False, allow_unicode=True, default_flow_style=None)


def _real(settings: Settings, cell: CellFile) -> tuple[Settings, list[str]]:
    """Port and pyrometer of the file, where the command line has none; what it says against the file."""
    said = []
    for path, option in ((PORT, 'port'), (PYROMETER, 'pyrometer')):
        told, given = cell.values.get(path, ''), getattr(settings, option)
        if told and given and told != given:
            said.append(f'--{option} {given} counts, not {cell.where(path)} ({told})')
        settings = replace(settings, **{option: given or told})
    if settings.simulated and settings.pyrometer == cell.values.get(PYROMETER):
        settings = replace(settings, pyrometer='')  # a file without a port: the cell is simulated
    return settings, said


def _against(cell: CellFile, settings: Settings) -> Iterator[str]:
    """Where the user's parameter files say something else, which counts. GraphError where it is told to the
    controller: no job would start."""
    for node, wanted in cell.parameters(settings.simulated).items():
        said = told_to(node, settings)
        for name, value in wanted.items():
            if name not in said or alike(said[name], value):
                continue
            path = cell.key_of(node, name)
            text = f'{node} {name} is {said[name]} in a --params-file, {cell.where(path)} is {cell.values[path]}'
            if path.startswith(MACHINE):
                raise GraphError(
                    f'{text}: what the controller is told stands in the cell file alone'
                )
            yield f'{text}: the parameter file counts'
