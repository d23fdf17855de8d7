"""Every rule of the import table is broken once, on a small workspace: the guard must see it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from import_graph import Workspace, largest_flat_folder, longest_call
from import_table import Table, Violation

TABLE = Table(
    may_import={'waam_low': set(), 'waam_high': {'waam_low'}},
    no_messages={'waam_low'},
    world={r'waam_high/waam_high/store\.py': 'files'},
    decodes=set(),
)


class Source:
    """A source folder that is written package by package."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def package(self, name: str, *declared: str) -> Source:
        xml = ''.join(f'<exec_depend>{d}</exec_depend>' for d in declared)
        self.write(f'{name}/package.xml', f'<package>{xml}</package>')
        return self.write(f'{name}/{name}/__init__.py', '')

    def write(self, file: str, text: str) -> Source:
        path = self.folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return self

    def core(self, text: str, name: str = 'core') -> Source:
        return self.write(f'waam_high/waam_high/{name}.py', text)

    def violations(self, table: Table = TABLE) -> set[Violation]:
        return table.violations(Workspace(self.folder))


@pytest.fixture
def source(tmp_path) -> Source:
    """Two packages without a fault."""
    good = Source(tmp_path).package('waam_low').package('waam_high', 'waam_low', 'waam_msgs')
    good.write('waam_low/waam_low/shape.py', 'import numpy\n')
    good.write('waam_high/waam_high/core.py', 'from waam_low.shape import numpy\n')
    good.write('waam_high/waam_high/any_node.py', 'import rclpy, time\nfrom . import core\n')
    good.write('waam_high/waam_high/store.py', 'text = open(0)\n')
    return good


def test_a_workspace_without_fault_passes(source):
    assert source.violations() == set()


@pytest.mark.parametrize(
    'text',
    [
        'from .other import x',
        'import waam_high.other',
        'from waam_high import other',
        'from . import other',
        'from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from .other import x',
        'def f():\n    from .other import x',
    ],
)
def test_circle_between_files(source, text):
    source.core(text).core('from . import core', 'other')
    rule = 'circle of files'
    assert source.violations() == {
        Violation('waam_high/waam_high/core.py', rule),
        Violation('waam_high/waam_high/other.py', rule),
    }


def test_circle_over_three_files(source):
    source.core('from . import b').core('from . import c', 'b').core('from . import core', 'c')
    assert len(source.violations()) == 3


def test_circle_between_rooms(source):
    room = 'waam_high/waam_high'
    source.write(f'{room}/one/__init__.py', '').write(f'{room}/two/__init__.py', '')
    source.write(f'{room}/one/a.py', 'from ..two import b').write(f'{room}/two/b.py', '')
    assert source.violations() == set()
    source.write(f'{room}/two/c.py', 'from ..one.d import x').write(f'{room}/one/d.py', 'x = 1')
    rule = 'circle of rooms'
    assert source.violations() == {
        Violation('waam_high.one', rule),
        Violation('waam_high.two', rule),
    }


def test_circle_between_packages(source):
    source.package('waam_low', 'waam_high')
    source.write('waam_low/waam_low/back.py', 'from waam_high import store')
    table = Table(
        **{**vars(TABLE), 'may_import': {'waam_low': {'waam_high'}, 'waam_high': {'waam_low'}}}
    )
    rule = 'circle of packages'
    assert source.violations(table) == {
        Violation('waam_low', rule),
        Violation('waam_high', rule),
    }


def test_import_that_the_table_does_not_allow(source):
    source.package('waam_low', 'waam_other')
    source.write('waam_low/waam_low/up.py', 'def f():\n    import waam_other.thing\n')
    assert source.violations() == {Violation('waam_low', 'may not import waam_other')}


def test_package_that_is_not_in_the_table_may_import_nothing(source):
    source.package('waam_new', 'waam_low').write('waam_new/waam_new/a.py', 'import waam_low.shape')
    assert source.violations() == {Violation('waam_new', 'may not import waam_low')}


@pytest.mark.parametrize('tag', ['test_depend', 'build_depend'])
def test_import_that_package_xml_does_not_declare(source, tag):
    source.write('waam_high/package.xml', f'<package><{tag}>waam_low</{tag}></package>')
    assert source.violations() == {Violation('waam_high', 'package.xml does not declare waam_low')}


@pytest.mark.parametrize(
    'text',
    [
        'import rclpy',
        'from rclpy.node import Node',
        'from waam_msgs.msg import Telemetry',
        'from std_srvs.srv import SetBool',
        'def f():\n    import geometry_msgs.msg',
        'from .any_node import f',  # through another module
    ],
)
def test_ros_in_a_core(source, text):
    source.write('waam_high/waam_high/any_node.py', 'import rclpy')
    assert (
        Violation('waam_high/waam_high/core.py', 'ROS in a core') in source.core(text).violations()
    )


def test_ros_in_a_package_without_messages(source):
    source.write('waam_low/waam_low/any_node.py', 'from waam_msgs.msg import Telemetry')
    assert source.violations() == {
        Violation('waam_low', 'may not import waam_msgs'),
        Violation('waam_low', 'package.xml does not declare waam_msgs'),
        Violation('waam_low/waam_low/any_node.py', 'ROS in a core'),
    }


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
def test_clock_in_a_core(source, text):
    assert source.core(text).violations() == {
        Violation('waam_high/waam_high/core.py', 'clock in a core')
    }


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
def test_io_in_a_core(source, text):
    assert source.core(text).violations() == {
        Violation('waam_high/waam_high/core.py', 'io in a core')
    }


def test_a_file_of_the_world_still_knows_no_ros(source):
    source.core('import rclpy\nopen(0)\n', 'store')
    assert source.violations() == {Violation('waam_high/waam_high/store.py', 'ROS in a core')}


@pytest.mark.parametrize(
    'text',
    ["'a'.replace('a', 'b')", 'np.loads', 'x = timer.time', 'import timeit', 'date(2026, 1, 1)'],
)
def test_what_looks_alike_is_no_violation(source, text):
    assert source.core(text).violations() == set()


def test_figures(source):
    source.core('def f(a, b, c): ...\nf(1, 2, 3)\ndef words(*w): ...\nwords(1, 2, 3, 4, 5)\n')
    workspace = Workspace(source.folder)
    count, where = longest_call({m.file: m.tree for m in workspace.modules.values()})
    assert count == 3 and re.match(r'waam_high/waam_high/core\.py:2 f', where)
    assert largest_flat_folder(source.folder) == (4, 'waam_high/waam_high')
