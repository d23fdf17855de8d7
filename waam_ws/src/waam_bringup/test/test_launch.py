"""`waam up` and the launch file start the same: programs, names, parameters, topics, environment."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from waam_bringup import supervisor as supervising
from waam_bringup.graph import Settings, executable
from waam_bringup.supervisor import Supervisor

LAUNCH = Path(__file__).parents[1] / 'launch' / 'cell.launch.py'
OWN = {'ROS_LOG_DIR', 'NOTIFY_SOCKET'}  # of the supervisor


class Said(SimpleNamespace):
    """An action of the launch library: what it was told."""

    def __init__(self, *_, **told) -> None:
        super().__init__(**told)


@pytest.fixture
def actions(monkeypatch):
    """actions(**arguments) -> what the launch file hands to the libraries, which no wheel brings."""
    known = {
        'launch': ('LaunchDescription',),
        'launch.actions': ('DeclareLaunchArgument', 'ExecuteProcess', 'OpaqueFunction'),
        'launch.substitutions': ('LaunchConfiguration',),
        'launch_ros': (),
        'launch_ros.actions': ('Node',),
    }
    for name, classes in known.items():
        module = ModuleType(name)
        for one in classes:
            setattr(module, one, type(one, (Said,), {}))
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location('cell_launch', LAUNCH)
    file = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(file)
    monkeypatch.setattr(file, 'time', SimpleNamespace(time=lambda: 7.5))
    monkeypatch.setattr(file, 'panel_port', lambda: 8601)
    monkeypatch.setattr(file, 'stop_port', lambda page: page + 1)

    def start(**given):
        class Configuration:
            def __init__(self, name: str) -> None:
                self.name = name

            def perform(self, _: object) -> str:
                return given.get(self.name, file.ARGUMENTS[self.name][0])

        monkeypatch.setattr(file, 'LaunchConfiguration', Configuration)
        assert file.generate_launch_description()
        return file._start(None)

    return start


def words_of(action: Said) -> list[str]:
    """The command line as launch_ros makes it of a Node."""
    if hasattr(action, 'cmd'):
        return action.cmd
    space = [('__ns', action.namespace)] if action.namespace else []
    rules = [('__node', action.name), *space, *action.remappings]
    program = [str(executable(action.package, action.executable)), *action.arguments]
    own = ['--ros-args', *action.ros_arguments, '--ros-args']
    return [*program, *own, *(w for a, b in rules for w in ('-r', f'{a}:={b}'))]


def meaning(words: list[str]) -> tuple[list[str], list[str], set[str]]:
    """The program's own words, its parameters in their order, and its rules of names, in any."""
    at = words.index('--ros-args') if '--ros-args' in words else len(words)
    ros = list(zip(words[at:], words[at + 1 :], strict=False))
    return (
        words[:at],
        [b for a, b in ros if a in ('-p', '--params-file')],
        {b for a, b in ros if a == '-r'},
    )


@pytest.mark.parametrize('machine', ['gantry', 'robot'])
@pytest.mark.parametrize('namespace', ['', 'cell2'])
def test_both_starters_start_the_same(tmp_path, monkeypatch, actions, machine, namespace):
    file = tmp_path / 'own.yaml'
    file.write_text('/**/bridge: {ros__parameters: {speed_max: 0.4}}\n')
    monkeypatch.setenv('ROS_DOMAIN_ID', '63')
    for name in ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'FASTRTPS_DEFAULT_PROFILES_FILE'):
        monkeypatch.delenv(name, raising=False)
    by_launch = actions(
        run=str(tmp_path), machine=machine, namespace=namespace, params_files=str(file)
    )
    started: list[tuple[list[str], dict[str, str]]] = []

    def note(command, env, **_):
        started.append((command, env))
        return SimpleNamespace(pid=len(started))

    monkeypatch.setattr(supervising.subprocess, 'Popen', note)
    settings = Settings(
        tmp_path, machine=machine, namespace=namespace, params_files=(file,), epoch_us=7_000_000, panel_port=8601,
        stop_port=8602,
    )  # fmt: skip
    by_supervisor = Supervisor(settings, 63)
    by_supervisor.start()
    assert len(started) == len(by_launch) > 8
    for (command, env), action, spec in zip(started, by_launch, by_supervisor.specs, strict=True):
        assert meaning(words_of(action)) == meaning(command)
        assert action.respawn is spec.restart_always
        other = {**os.environ, **action.additional_env}
        assert {k: v for k, v in env.items() if k not in OWN} == {
            k: v for k, v in other.items() if k not in OWN
        }
        assert other['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    cell = meaning(started[-1][0])
    assert ('/clock:=clock' in cell[2]) is bool(namespace)
    assert str(file) in cell[1] and 'use_sim_time:=true' in cell[1]


def test_a_level_of_the_log_is_for_every_node(tmp_path, actions):
    for action in actions(run=str(tmp_path), log_level='debug'):
        words = words_of(action)
        assert ('debug' in words) is ('--ros-args' in words)
