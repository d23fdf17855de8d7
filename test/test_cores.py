"""Every rule of the import table is broken once: the guard must see it."""

from __future__ import annotations

import ast

import pytest
from cores import violations
from purity import Module, longest_call

CORE, STORE = 'waam_scan/waam_scan/core.py', 'waam_scan/waam_scan/map_file.py'


def found(text: str, file: str = CORE, *know_ros: str) -> set[tuple[str, str]]:
    name = file.split('/', 1)[1].removesuffix('.py').replace('/', '.')
    return violations([Module(name, file, ast.parse(text))], set(know_ros))


@pytest.mark.parametrize('file', [CORE, STORE, 'waam_plan/waam_plan/any_node.py'])
def test_ros_in_a_core(file):
    name = file.split('/', 1)[1].removesuffix('.py').replace('/', '.')
    assert found('', file, name) == {(file, 'ROS')}


def test_nodes_and_commands_may_know_all_of_it():
    for file in (
        'waam_scan/waam_scan/any_node.py',
        'waam_job/waam_job/ros/x.py',
        'waam_node/waam_node/x.py',
    ):
        name = file.split('/', 1)[1].removesuffix('.py').replace('/', '.')
        assert not found("import time, socket\ntime.time()\nopen('x')", file, name)
    assert not found("open('x')", STORE)


@pytest.mark.parametrize(
    'text',
    [
        'import time\ntime.time()',
        'import time\ndef f(clock=time.monotonic): ...',
        'from time import perf_counter',
        'import datetime\ndatetime.datetime.now()',
        'from datetime import datetime\ndatetime.now()',
        'import time\ndef f():\n    time.sleep(1)',
    ],
)
def test_clock_in_a_core(text):
    assert found(text) == {(CORE, 'clock')}


@pytest.mark.parametrize(
    'text',
    [
        "open('x')",
        'def f(path):\n    return path.read_text()',
        'def f(path):\n    path.write_bytes(b"")',
        'import numpy as np\ndef f(path):\n    return np.load(path)',
        'import socket',
        'from subprocess import run',
        'def f():\n    import socket',
        'import urllib.request',
    ],
)
def test_io_in_a_core(text):
    assert found(text) == {(CORE, 'io')}


@pytest.mark.parametrize(
    'text',
    ["'a'.replace('a', 'b')", 'np.loads', 'x = timer.time', 'import timeit', 'date(2026, 1, 1)'],
)
def test_what_looks_alike_is_no_violation(text):
    assert found(text) == set()


def test_longest_call():
    text = 'def f(a, b, c): ...\nf(1, 2, 3)\ndef words(*w): ...\nwords(1, 2, 3, 4, 5)\n'
    assert longest_call({CORE: ast.parse(text)}) == (3, f'{CORE}:2 f')
