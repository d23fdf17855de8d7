"""Every node starts alone, by the rules of `ros2 run`, with a parameter file; mistakes in parameters are named."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import pytest
import yaml

from waam_bringup.graph import executable, load
from waam_bringup.paths import share
from waam_node.testing import fresh_domain

# executable, its package, and the name of its node
NODES = [(e, d['package'], d.get('name', e)) for e, d in load().items() if d.get('ros', True)]


DOMAIN = fresh_domain()


def start(program: str, package: str, *arguments: str, domain: int = DOMAIN) -> subprocess.Popen:
    environment = dict(os.environ, ROS_DOMAIN_ID=str(domain))
    command = [str(executable(package, program)), '--ros-args', *arguments]
    return subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


@pytest.mark.parametrize('program,package,name', NODES)
def test_unknown_parameter_is_refused_by_name(program, package, name):
    node = start(program, package, '-p', 'no_such_thing:=1')
    output, _ = node.communicate(timeout=60)
    assert node.returncode == 2
    assert f"{name}: unknown parameter 'no_such_thing'" in output
    assert 'Traceback' not in output


@pytest.mark.parametrize('program,package,name', NODES)
def test_misspelt_parameter_in_a_file_is_refused(program, package, name, tmp_path):
    text = yaml.safe_load((share(package) / 'config' / f'{name}.yaml').read_text())
    values = text[f'/**/{name}']['ros__parameters']
    first = next(iter(values))
    values[first + 'x'] = values.pop(first)
    file = tmp_path / 'params.yaml'
    file.write_text(yaml.safe_dump(text))
    node = start(program, package, '--params-file', str(file))
    output, _ = node.communicate(timeout=60)
    assert node.returncode == 2 and f"unknown parameter '{first}x'" in output


@pytest.mark.parametrize('program,package,name', NODES)
def test_starts_with_its_own_file_and_stops_cleanly(program, package, name, tmp_path):
    from waam_bringup.client import GraphClient

    file: Path = share(package) / 'config' / f'{name}.yaml'
    domain = fresh_domain()  # two programs have the name `cell`
    node = start(program, package, '--params-file', str(file), domain=domain)
    try:
        with GraphClient(domain) as client:
            up = client.until(lambda: name in client.node.get_node_names(), 40)
    finally:
        node.send_signal(signal.SIGTERM)
        try:
            output, _ = node.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            node.send_signal(signal.SIGUSR1)  # where every thread is
            node.kill()
            output, _ = node.communicate()
    assert up, f'{name} did not appear: {output}'
    assert node.returncode == 0, output
    assert 'Traceback' not in output, output
