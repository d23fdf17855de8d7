"""ros2 launch waam_bringup cell.launch.py port:=/dev/serial/by-id/... (empty = simulated cell)

For full ROS installations. Starts the same processes as `waam up`, from the same description.
"""

import os
import time
from pathlib import Path

from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription
from waam_bringup.graph import Settings, middleware, processes
from waam_bringup.operate import panel_port, stop_port
from waam_bringup.paths import run_dir
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
        machine=value['machine'],
        preset=value['preset'],
        panel_port=page,
        stop_port=stop_port(page),
    )
    return [
        ExecuteProcess(
            cmd=p.command,
            name=p.name,
            output='screen',
            additional_env={**middleware(os.environ), **p.environment},
        )
        for p in processes(settings)
    ]


ARGUMENTS = {  # name: default, help, choices
    'port': ('', 'controller; empty = simulated', None),
    'pyrometer': ('', "of a real cell, as of `waam up`", None),
    'rate': ('0', 'simulated s per s, 0 = no limit', None),
    'seed': ('1', 'seed of the simulated cell', None),
    'run': (str(run_dir()), 'sockets and state', None),
    'machine': (GANTRY, 'what moves the torch', list(MACHINES)),
    'preset': (DEFAULT_PRESET, 'how rough the simulated cell is', list(PRESETS)),
}


def generate_launch_description():
    declared = [
        DeclareLaunchArgument(n, default_value=value, description=text, choices=choices)
        for n, (value, text, choices) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_start)])
