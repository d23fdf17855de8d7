"""ros2 launch waam_bringup cell.launch.py port:=/dev/serial/by-id/... (empty = simulated cell)

For full ROS installations. Starts the same processes as `waam up`, from the same description (config/graph.yaml), in
the ROS domain of the shell. What hangs is not started again here: that is the supervisor's.
"""

import os
import time
from pathlib import Path

from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from waam_bringup.graph import Settings, environment, processes
from waam_bringup.operate import panel_port, stop_port
from waam_bringup.paths import run_dir
from waam_bringup.supervisor import DEAD_S
from waam_process.operating import DEFAULT_PRESET, GANTRY, MACHINES, PRESETS


def _start(context):
    value = {k: LaunchConfiguration(k).perform(context) for k in ARGUMENTS}
    run = Path(value['run'])
    run.mkdir(parents=True, exist_ok=True)
    page = panel_port()
    settings = Settings(
        run=run,
        port=value['port'],
        pyrometer=value['pyrometer'],
        rate=float(value['rate']),
        seed=int(value['seed']),
        epoch_us=int(time.time()) * 1_000_000,
        params_files=tuple(Path(f).resolve() for f in value['params_files'].split()),
        without=tuple(value['without'].split()),
        machine=value['machine'],
        preset=value['preset'],
        panel_port=page,
        stop_port=stop_port(page),
        namespace=value['namespace'].strip('/'),
    )
    return [_action(p, value['log_level']) for p in processes(settings)]


def _action(p, log_level):
    """What starts one process, and again where the supervisor would."""
    common = {
        'output': 'screen',
        'additional_env': {**environment(os.environ), **p.environment},
        'respawn': p.restart_always,
        'respawn_delay': DEAD_S,
    }
    if not p.ros:
        return ExecuteProcess(cmd=p.command, name=p.name, **common)
    level = ['--log-level', log_level] if log_level else []
    return Node(
        package=p.package,
        executable=p.executable,
        name=p.name,
        exec_name=p.name,
        namespace=f'/{p.namespace}' if p.namespace else None,
        remappings=list(p.remappings),
        arguments=p.arguments,
        ros_arguments=[*p.ros_arguments, *level],
        **common,
    )


ARGUMENTS = {  # name: default, help, choices
    'port': ('', 'controller; empty = simulated', None),
    'pyrometer': ('', 'of a real cell, as of `waam up`', None),
    'rate': ('0', 'simulated s per s, 0 = no limit', None),
    'seed': ('1', 'seed of the simulated cell', None),
    'run': (str(run_dir()), 'sockets and state', None),
    'machine': (GANTRY, 'what moves the torch', list(MACHINES)),
    'preset': (DEFAULT_PRESET, 'how rough the simulated cell is', list(PRESETS)),
    'namespace': (
        '',
        'of every node; cells in one ROS domain need one each, and a `run` each',
        None,
    ),
    'params_files': ('', 'ROS parameter files for all nodes', None),
    'without': ('', 'nodes that are left out', None),
    'log_level': ('', 'of the nodes, such as debug or bridge:=debug', None),
}


def generate_launch_description():
    declared = [
        DeclareLaunchArgument(n, default_value=value, description=text, choices=choices)
        for n, (value, text, choices) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_start)])
