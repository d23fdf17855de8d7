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
    names = ('port', 'rate', 'seed', 'run', 'machine', 'preset')
    value = {k: LaunchConfiguration(k).perform(context) for k in names}
    run = Path(value['run'])
    run.mkdir(parents=True, exist_ok=True)
    page = panel_port()
    settings = Settings(
        run=run,
        port=value['port'],
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


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'port', default_value='', description='controller; empty = simulated'
            ),
            DeclareLaunchArgument(
                'rate', default_value='0', description='simulated s per s, 0 = no limit'
            ),
            DeclareLaunchArgument(
                'seed', default_value='1', description='seed of the simulated cell'
            ),
            DeclareLaunchArgument(
                'run', default_value=str(run_dir()), description='sockets and state'
            ),
            DeclareLaunchArgument(
                'machine',
                default_value=GANTRY,
                description='what moves the torch',
                choices=list(MACHINES),
            ),
            DeclareLaunchArgument(
                'preset',
                default_value=DEFAULT_PRESET,
                description='how rough the simulated cell is',
                choices=list(PRESETS),
            ),
            OpaqueFunction(function=_start),
        ]
    )
