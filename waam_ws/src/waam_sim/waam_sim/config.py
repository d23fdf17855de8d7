"""Parameters of the node `cell`: those of every core under a prefix (`metal_levelling`) and a few of its own. What a
core has as a plain number (without `param`) is a constant of the cell that nobody has ever set."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from waam_node.params import param

from .arc import ArcParams
from .delivered import DeliveredParams
from .distance import DistanceParams
from .gantry import GantryParams
from .heat import HeatParams
from .metal_params import MetalParams
from .placement import PlacementParams
from .plant import PlantParams
from .pyrometer import PyrometerParams
from .robot import RobotParams
from .scanner import ScannerParams
from .variation import VariationParams

GROUPS = {
    'metal': MetalParams,
    'heat': HeatParams,
    'arc': ArcParams,
    'scanner': ScannerParams,
    'pyrometer': PyrometerParams,
    'part': PlacementParams,
    'distance': DistanceParams,
    'robot': RobotParams,
    'gantry': GantryParams,
    'variation': VariationParams,
    'delivered': DeliveredParams,
}


@dataclass(frozen=True)
class NodeParams:
    """Parameters of the node itself."""

    plant_socket: str = param(
        '/tmp/waam_plant', 'Unix socket of the virtual controller (plant port)'
    )
    seed: int = param(1, 'of everything random in the cell', '', 0)
    truth_dir: str = param('.', 'folder for the true surface written by ~/save_truth')
    work_zero: tuple = param(
        (0.100, 0.080, 0.020), 'where the part is clamped, machine coordinates', 'm'
    )
    plate: tuple = param(
        (0.120, 0.080, 0.025), 'size of the plate on the table until a part is loaded', 'm'
    )
    table_file: str = param(
        '', 'file that keeps what lies on the table when the cell ends; empty = nothing is kept'
    )
    chuck_steps_per_turn: float = param(
        0.0,
        'of the chuck that turns shafts in place of the X axis; 0 = X is a straight axis. The virtual controller then '
        'moves X by turns (--machine-steps: a thousandth of it)',
        '',
        0.0,
    )
    pace: float = param(1.0, 'of a cell with a robot: simulated seconds per second', '', 0.01, 20.0)


def _flat() -> type:
    """One dataclass with the fields of the node and, prefixed, of all groups."""
    fields: list[tuple[str, Any, Any]] = [
        (f.name, f.type, dataclasses.field(default=f.default, metadata=f.metadata))
        for f in dataclasses.fields(NodeParams)
    ]
    for group, cls in GROUPS.items():
        fields += [
            (f'{group}_{f.name}', f.type, dataclasses.field(default=f.default, metadata=f.metadata))
            for f in dataclasses.fields(cls)
            if f.metadata
        ]
    return dataclasses.make_dataclass('CellParams', fields, frozen=True)


CellParams = _flat()


def plant_params(params: Any) -> PlantParams:
    """The parameters of the physics from a CellParams; ValueError when work_zero is not a point."""
    if len(params.work_zero) != 3 or len(params.plate) != 3:
        raise ValueError("parameters 'work_zero' and 'plate' need three numbers each (m)")
    groups = {
        group: cls(
            **{
                f.name: getattr(params, f'{group}_{f.name}')
                for f in dataclasses.fields(cls)
                if f.metadata
            }
        )
        for group, cls in GROUPS.items()
    }
    x, y, z = (float(v) for v in params.work_zero)
    return PlantParams(work_zero=(x, y, z), **groups)
