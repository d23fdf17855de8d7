"""The graph description (config/graph.yaml) turned into processes. Pure: no process is started, no ROS is needed."""

from __future__ import annotations

import json
import os
import re
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from waam_node import priority
from waam_node.parameter_files import matches
from waam_process.names import TEMPERATURE_INPUTS
from waam_process.operating import DEFAULT_PRESET, GANTRY, ROBOT, check_preset
from waam_shop.cells import FIRST

from .paths import calibrations_dir, cell_name, jobs_dir, share, shop_dir


class GraphError(ValueError):
    """The description or a setting of the graph is wrong; the text names the node and the key."""


@dataclass(frozen=True)
class Settings:
    """Settings of one start of the graph."""

    run: Path  # folder for sockets, logs and state
    port: str = ''  # serial port of a real controller; '' = simulated cell
    rate: float = 0.0  # simulated seconds per second at most; 0 = as fast as it goes
    seed: int = 1  # of everything random in the cell
    # per mm, of the simulated gantry, x y z
    machine_steps: tuple[float, float, float] = (320.0, 320.0, 320.0)
    epoch_us: int = 1
    grpc_port: int = 0
    web_port: int = 0
    panel_port: int = 0  # of the operator's page; 0 = any free one
    stop_port: int = 0  # of the second way for its STOP; 0 = none
    # s of silence while no job runs, after which a node is restarted; 0 = never
    hang_timeout: float = 15.0
    params_files: tuple[Path, ...] = ()
    without: tuple[str, ...] = ()
    machine: str = GANTRY  # or another of MACHINES
    preset: str = DEFAULT_PRESET  # of PRESETS: how rough the simulated cell is
    pyrometer: str = ''  # of a real cell: one of TEMPERATURE_INPUTS, or a source of its node
    namespace: str = ''  # of every node; '' = none, then the cell has a ROS domain of its own

    @property
    def simulated(self) -> bool:
        """Whether the cell is simulated: no port of a real controller is given."""
        return not self.port

    @property
    def temperature_input(self) -> str:
        """Of the controller, for the part."""
        return self.pyrometer if self.pyrometer in TEMPERATURE_INPUTS else TEMPERATURE_INPUTS[0]

    @property
    def instrument(self) -> bool:
        """Whether the part's temperature comes from a node of its own."""
        return bool(self.pyrometer) and self.pyrometer not in TEMPERATURE_INPUTS

    @property
    def paced(self) -> bool:
        """Whether the graph keeps step with the wall clock, so that a late answer is late in the cell as well."""
        return not self.simulated or 0 < self.pace <= 1

    @property
    def pace(self) -> float:
        """Simulated seconds per second; 0 = as fast as it goes, which a robot's cell cannot."""
        return self.rate or (1.0 if self.machine == ROBOT else 0.0)


@dataclass(frozen=True)
class Process:
    """One process: name (= node name), command line and what it is made of, whether it is a ROS node, whether the arc
    lease needs it, what is added to its environment, and when it is started again. ros_arguments: those that stand
    behind --ros-args in the command line, but for name, namespace and remappings."""

    name: str
    command: list[str]
    ros: bool = True
    lease: bool = True
    package: str = ''
    executable: str = ''
    arguments: list[str] = field(default_factory=list)
    ros_arguments: list[str] = field(default_factory=list)
    namespace: str = ''
    remappings: tuple[tuple[str, str], ...] = ()
    environment: dict[str, str] = field(default_factory=dict)
    restart: bool = False  # when it hangs between jobs
    restart_always: bool = False  # whenever it has died


# topics that are not below a namespace by themselves: two cells in one ROS domain would hear each other's
SHARED = tuple((f'/{name}', name) for name in ('clock', 'tf', 'tf_static', 'diagnostics'))
STOP_LANE = 'stop_lane'  # in the graph when it has a port
CELL = 'cell'  # node of the simulated cell, whatever its machine
ONLY: dict[str, Callable[[Settings], bool]] = {  # when a node is in the graph
    '': lambda s: True,
    'sim': lambda s: s.simulated,
    'pyrometer': lambda s: s.instrument,
}
KEYS = {
    'package', 'executable', 'only', 'ros', 'lease', 'realtime', 'arguments', 'parameters', 'use_sim_time', 'restart',
    'machine', 'name',
}  # fmt: skip


def environment(given: Mapping[str, str]) -> dict[str, str]:
    """What every process is told beside the environment `given`, whoever starts it: lines of a log come when they are
    written, and others are looked for on this computer only, unless somebody says how: an open cell is a safety hole.
    """
    return {'PYTHONUNBUFFERED': '1', **_middleware(given)}


def _middleware(given: Mapping[str, str]) -> dict[str, str]:
    if given.get('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST') != 'LOCALHOST':
        return {}  # who wants others to come in says how
    profile = share('waam_bringup') / 'config' / 'fastdds.xml'
    wanted = {
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'FASTRTPS_DEFAULT_PROFILES_FILE': str(profile),
    }
    return {k: v for k, v in wanted.items() if not given.get(k)}


def load(path: Path | None = None) -> dict[str, dict[str, Any]]:
    """The description, checked; an unknown key is refused by name."""
    path = path or share('waam_bringup') / 'config' / 'graph.yaml'
    try:
        text = yaml.safe_load(path.read_text())
    except (OSError, yaml.YAMLError) as e:
        raise GraphError(f'{path}: {e}') from None
    for name, node in text.items():
        for key in node:
            if key not in KEYS:
                raise GraphError(f"{path}: node {name}: unknown key '{key}'")
        if 'package' not in node:
            raise GraphError(f'{path}: node {name}: package is missing')
    return text


def executable(package: str, name: str) -> Path:
    """Where `ros2 run` would find it: <prefix>/lib/<package>/<name>."""
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(':'):
        candidate = Path(prefix) / 'lib' / package / name
        if prefix and candidate.exists():
            return candidate
    raise GraphError(
        f'executable {name} of package {package} is not installed (is the workspace built and sourced?)'
    )


def fill(value: Any, settings: Settings, lease_nodes: list[str]) -> Any:
    """Replaces ${name} in a value; a string that is only ${name} keeps the type of the setting."""
    known = {
        **vars(settings), 'run': str(settings.run), 'port': settings.port or str(settings.run / 'controller'),
        'pace': settings.pace, 'temperature_input': settings.temperature_input,
        'machine_steps': machine_steps(settings),
        'panel_access': panel_access(settings), 'jobs': str(jobs_dir()), 'shop': str(shop_dir()),
        'calibrations': str(calibrations_dir()), 'cell': cell_name(), 'lease_nodes': lease_nodes,
        'commission': commission_words(settings.run),
        'named_cell': '' if cell_name() == FIRST else cell_name(), 'parts': str(share('waam_bringup') / 'parts'),
    }  # fmt: skip
    if isinstance(value, list):
        return [fill(v, settings, lease_nodes) for v in value]
    if not isinstance(value, str):
        return value
    whole = re.fullmatch(r'\$\{(\w+)\}', value)
    names = re.findall(r'\$\{(\w+)\}', value)
    for name in names:
        if name not in known:
            raise GraphError(f'graph description: unknown variable ${{{name}}}')
    if whole:
        return known[whole.group(1)]
    return re.sub(r'\$\{(\w+)\}', lambda m: str(known[m.group(1)]), value)


def commission_words(run: Path) -> str:
    """For Python: `waam commission` of the cell that is meant, on the graph in this folder; for the panel."""
    words = ('-m', 'waam_bringup.cli', 'commission', cell_name(), '--run', str(run))
    return shlex.join(words)


ACCESS = {
    'port': '--page-port', 'bind': '--bind', 'token_file': '--token-file', 'tls_cert': '--tls-cert',
    'tls_key': '--tls-key', 'allowed_hosts': '--hosts',
}  # fmt: skip


def panel_access(settings: Settings) -> list[str]:
    """What parameter files say of who may ask the panel, as options of stop_lane: both must have the same rules."""
    told = told_to('panel', settings)
    return [word for k, v in told.items() if k in ACCESS for word in (ACCESS[k], str(v))]


def told_to(node: str, settings: Settings) -> dict[str, Any]:
    """What parameter files say to a node; the last one wins."""
    found: dict[str, Any] = {}
    whole = f'/{settings.namespace}/{node}'.replace('//', '/')
    for file in settings.params_files:
        try:
            text = yaml.safe_load(file.read_text())
        except (OSError, ValueError, yaml.YAMLError) as e:
            raise GraphError(f'{file}: {e}') from None
        blocks = text if isinstance(text, dict) else {}
        for name in sorted(
            blocks, key=lambda n: (-str(n).count('*'), len(str(n)))
        ):  # the closest wins
            told = blocks[name] if matches(str(name), whole) else None
            values = told.get('ros__parameters') if isinstance(told, dict) else None
            found |= values if isinstance(values, dict) else {}
    return found


def machine_steps(settings: Settings) -> str:
    """Steps that a mm of the simulated gantry takes: by --machine-steps, else those of the bridge's parameters. Of a
    chuck in place of X a thousandth of those of a turn, for its cell knows turns."""
    told = told_to('bridge', settings)
    if turn := told_to('job_sequencer', settings).get('chuck_steps_per_turn'):
        told['steps_per_mm_x'] = turn / 1e3
    usual = Settings.machine_steps
    found = [
        told.get(f'steps_per_mm_{axis}', has) if has == default else has
        for axis, has, default in zip('xyz', settings.machine_steps, usual, strict=True)
    ]
    return ','.join(f'{v:.10g}' for v in found)


def check_params(file: Path, description: dict[str, dict[str, Any]]) -> None:
    """ROS passes over the values of a node that there is not. GraphError names it, or says why the file is none."""
    try:
        data = yaml.safe_load(file.read_text())
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as e:
        raise GraphError(f'--params-file {file}: {e}') from None
    if not isinstance(data, dict):
        raise GraphError(f'--params-file {file}: must hold node: ros__parameters: name: value')
    known = sorted({d.get('name', n) for n, d in description.items() if d.get('ros', True)})
    for key in map(str, data):
        name = key.rpartition('/')[2]
        if '*' not in name and name not in known:
            raise GraphError(
                f"--params-file {file}: there is no node '{key}'; known are {', '.join(known)}, /**"
            )


def processes(settings: Settings, description: dict | None = None) -> list[Process]:
    """Every process in start order."""
    description = description or load()
    try:
        check_preset(settings.preset)
    except ValueError as e:
        raise GraphError(f'--preset: {e}') from None
    _check_pyrometer(settings)
    for file in settings.params_files:
        check_params(file, description)
    for name in settings.without:
        if name not in description:
            raise GraphError(f"--without {name}: no such node; known are {', '.join(description)}")
    chosen = {
        d.get('name', n): {'executable': n, **d}
        for n, d in description.items()
        if n not in settings.without
        and (settings.stop_port or n != STOP_LANE)
        and ONLY[d.get('only', '')](settings)
        and d.get('machine', settings.machine) == settings.machine
    }
    lease_nodes = [n for n, d in chosen.items() if d.get('ros', True) and d.get('lease', True)]
    return [_process(n, d, settings, lease_nodes) for n, d in chosen.items()]


def _check_pyrometer(settings: Settings) -> None:
    """There is one source of the temperature: two would contradict each other."""
    if settings.pyrometer and settings.simulated:
        raise GraphError('--pyrometer: the simulated cell has one of its own (real cell: --port)')
    if settings.machine == ROBOT and settings.temperature_input != TEMPERATURE_INPUTS[0]:
        raise GraphError(f'--pyrometer {settings.pyrometer}: a robot has no controller board')


def _process(name: str, node: dict, settings: Settings, lease_nodes: list[str]) -> Process:
    package, exe = node['package'], node.get('executable', name)
    filled = [fill(a, settings, lease_nodes) for a in node.get('arguments', [])]
    arguments = [str(a) for f in filled for a in (f if isinstance(f, list) else [f])]
    command, ros_arguments = [str(executable(package, exe)), *arguments], []
    ros, namespace = node.get('ros', True), settings.namespace
    remappings = SHARED if ros and namespace else ()
    if ros:
        ros_arguments = _ros_arguments(name, node, settings, lease_nodes)
        rules = [('__node', name), *([('__ns', f'/{namespace}')] if namespace else []), *remappings]
        command += [
            '--ros-args',
            *(w for a, b in rules for w in ('-r', f'{a}:={b}')),
            *ros_arguments,
        ]
    return Process(
        name=name,
        command=command,
        ros=ros,
        lease=node.get('lease', True),
        package=package,
        executable=exe,
        arguments=arguments,
        ros_arguments=ros_arguments,
        namespace=namespace if ros else '',
        remappings=remappings,
        environment={priority.VARIABLE: '1'} if settings.paced and node.get('realtime') else {},
        restart=ros and bool(node.get('restart', True)),
        restart_always=node.get('restart') == 'always',
    )


def preset_file(preset: str) -> Path:
    """Parameter file of a preset of the simulated cell; a user's files come after it and win."""
    return share('waam_sim') / 'config' / 'presets' / f'{preset}.yaml'


def _ros_arguments(name: str, node: dict, settings: Settings, lease_nodes: list[str]) -> list[str]:
    arguments = []
    defaults = share(node['package']) / 'config' / f'{name}.yaml'
    if defaults.exists():
        arguments += ['--params-file', str(defaults)]
    if name == CELL:
        arguments += ['--params-file', str(preset_file(settings.preset))]
    values = {k: fill(v, settings, lease_nodes) for k, v in node.get('parameters', {}).items()}
    values['use_sim_time'] = node.get('use_sim_time', settings.simulated)
    for key, value in values.items():
        arguments += ['-p', f'{key}:={json.dumps(value)}']
    for file in settings.params_files:
        arguments += ['--params-file', str(file)]
    return arguments
