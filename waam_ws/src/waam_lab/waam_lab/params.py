"""Parameters of the nodes that the laboratory replaces: the files that the graph loads, then the changes of a job.

One source: a default that changes in a package's config/<node>.yaml changes here as well.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import get_package_share_directory

from waam_adapt.feed.params import FeedParams
from waam_adapt.laws.corrector import CorrectionParams
from waam_adapt.process_control.params import ProcessControlParams
from waam_adapt.thermal.params import ThermalParams
from waam_bridge.params import BridgeParams
from waam_job.ros.job_params import JobParams
from waam_node.params import ParameterError, from_dict, hint
from waam_process.operating import DEFAULT_PRESET, GANTRY, ROBOT, check_preset
from waam_robot_bridge.params import RobotParams
from waam_scan.fusion_params import FusionParams
from waam_sim.config import CellParams

Overrides = Mapping[str, Mapping[str, Any]]

NODES: dict[str, tuple[str, type]] = {  # node: its package, its parameters
    'cell': ('waam_sim', CellParams),
    'bridge': ('waam_bridge', BridgeParams),
    'robot_bridge': ('waam_robot_bridge', RobotParams),
    'scan_fusion': ('waam_scan', FusionParams),
    'correction_server': ('waam_adapt', CorrectionParams),
    'feed_forward': ('waam_adapt', FeedParams),
    'thermal_compensator': ('waam_adapt', ThermalParams),
    'process_control': ('waam_adapt', ProcessControlParams),
    'job_sequencer': ('waam_job', JobParams),
}
EVERY = '/**'  # of a parameter file: for all nodes
BRIDGES = {GANTRY: 'bridge', ROBOT: 'robot_bridge'}  # node whose parameters count


@dataclass(frozen=True)
class LabParams:
    """The parameters of every node, filled."""

    cell: Any  # waam_sim.config.CellParams, which is made of the parameters of the physics
    bridge: BridgeParams
    robot_bridge: RobotParams
    scan_fusion: FusionParams
    correction_server: CorrectionParams
    feed_forward: FeedParams
    thermal_compensator: ThermalParams
    process_control: ProcessControlParams
    job_sequencer: JobParams

    def by_node(self, machine: str = GANTRY) -> dict[str, dict[str, Any]]:
        """As the job keeps them in job.yaml; of the two bridges that of the machine."""
        other = BRIDGES[ROBOT if machine == GANTRY else GANTRY]
        return {node: dataclasses.asdict(getattr(self, node)) for node in NODES if node != other}


def defaults(node: str) -> dict[str, Any]:
    """What the graph starts this node with."""
    package, _ = NODES[node]
    name = 'bridge' if node in BRIDGES.values() else node  # every machine's node is called so
    file = Path(get_package_share_directory(package)) / 'config' / f'{name}.yaml'
    return of_node(read_file(file), name)


def read_file(path: Path) -> dict[str, dict[str, Any]]:
    """A ROS parameter file, values by node. ParameterError names the file and what is wrong with it."""
    try:
        data = yaml.safe_load(path.read_text())
    except (OSError, yaml.YAMLError) as e:
        raise ParameterError(f'{path}: {e}') from None
    if not isinstance(data, dict):
        raise ParameterError(f'{path}: must hold node: ros__parameters: name: value')
    found = {}
    for node, block in data.items():
        values = block.get('ros__parameters') if isinstance(block, dict) else None
        if not isinstance(values, dict):
            raise ParameterError(f"{path}: '{node}' has no block 'ros__parameters'")
        found[str(node)] = values
    return found


def of_node(file: Mapping[str, Mapping[str, Any]], node: str) -> dict[str, Any]:
    """What `read_file` found for a node, by its name or by the wildcard of all nodes."""
    return {
        k: v
        for key in (EVERY, f'/**/{node}', f'/{node}', node)
        for k, v in file.get(key, {}).items()
    }


def of_preset(name: str) -> dict[str, Any]:
    """What a preset says of the node `cell`. ValueError names the presets that there are."""
    folder = Path(get_package_share_directory('waam_sim')) / 'config' / 'presets'
    return of_node(read_file(folder / f'{check_preset(name)}.yaml'), 'cell')


def make(*overrides: Overrides, preset: str = DEFAULT_PRESET) -> LabParams:
    """Defaults, changed by the preset of the cell and by `overrides`, later ones first. ValueError names what is
    unknown or out of range."""
    values = {node: defaults(node) for node in NODES}
    values['cell'] |= of_preset(preset)
    values['job_sequencer']['lease_nodes'] = ()  # the laboratory has no nodes with a heartbeat
    for override in overrides:
        for node, changed in override.items():
            if node not in NODES:
                raise ParameterError(f"unknown node '{node}'{hint(node, NODES)}")
            values[node] = {**values[node], **changed}
    filled = {node: from_dict(kind, values[node], node) for node, (_, kind) in NODES.items()}
    return LabParams(**filled)


def parse_settings(texts: Iterable[str]) -> dict[str, dict[str, Any]]:
    """`node.parameter=value` texts by node. ParameterError names what is unknown."""
    found: dict[str, dict[str, Any]] = {}
    for text in texts:
        key, equals, value = text.partition('=')
        node, dot, name = key.strip().partition('.')
        if not equals or not dot:
            raise ParameterError(f"'{text}' is not of the form node.parameter=value")
        if node not in NODES:
            raise ParameterError(f"unknown node '{node}' in '{text}'{hint(node, NODES)}")
        known = [f.name for f in dataclasses.fields(NODES[node][1])]
        if name not in known:
            raise ParameterError(f"unknown parameter '{node}.{name}'{hint(name, known)}")
        found.setdefault(node, {})[name] = yaml.safe_load(value)
    return found
