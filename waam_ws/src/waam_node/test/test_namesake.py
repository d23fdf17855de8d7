"""Two nodes by one name: the younger ends and says where the other one lives."""

import os
import signal
import subprocess
import sys
import time

import pytest

from waam_node.namesake import older
from waam_node.testing import fresh_domain

NODE = """
from dataclasses import dataclass
import waam_node.namesake
from waam_node.node import WaamNode, main
{before}
@dataclass(frozen=True)
class Nothing:
    pass
main(lambda: WaamNode('weld', Nothing))
"""


@pytest.fixture
def start():
    made: list[subprocess.Popen] = []
    env = os.environ | {'ROS_DOMAIN_ID': str(fresh_domain())}

    def begin(before: str = '') -> subprocess.Popen:
        command = [sys.executable, '-c', NODE.format(before=before)]
        made.append(subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True))
        return made[-1]

    yield begin
    for process in made:
        process.kill()
        process.communicate(timeout=30)


def heard(line: str, process: subprocess.Popen) -> None:
    """Waits for a line of the node's log."""
    assert process.stderr is not None
    while line not in process.stderr.readline():
        assert process.poll() is None


def test_the_second_node_by_a_name_ends_and_says_why(start):
    first = start()
    heard('priority', first)
    time.sleep(1.1)  # so that it is the older one by more than the clocks' second
    second = start()
    _, said = second.communicate(timeout=60)
    assert second.returncode == 2
    assert f'a node called weld runs already: process {first.pid} on' in said
    assert first.poll() is None


def test_one_that_was_killed_keeps_nobody_from_starting_again(start):
    """It stays in the graph for up to 20 s."""
    first = start()
    heard('priority', first)
    first.send_signal(signal.SIGKILL)
    first.wait()
    second = start('waam_node.namesake.YOUNG_S = 3.0')
    heard('priority', second)
    time.sleep(4.5)
    assert second.poll() is None


@pytest.mark.parametrize(
    ('other_up', 'other', 'is_older'),
    [
        ('9.0', 'z', True),
        ('1.0', 'a', False),
        ('3.5', 'a', True),
        ('3.5', 'z', False),
        ('', 'a', False),
        ('x', 'a', False),
        ('nan', 'a', False),
    ],
)
def test_of_two_nodes_exactly_one_is_the_older(other_up, other, is_older):
    assert older(other_up, other, 3.0, 'm') is is_older
    if other_up in ('9.0', '1.0', '3.5'):
        assert older('3.0', 'm', float(other_up), other) is not is_older
