"""The rooms of the core: who may know whom. Includes between rooms, and calls between files as the linker sees them."""

from __future__ import annotations

import re
import shutil
import subprocess
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

CORE = Path(__file__).parents[1] / 'core'
BELOW = {  # a room may use those named here and itself
    'common': set(),
    'link': {'common'},
    'gcode': {'common'},
    'motion': {'common', 'gcode'},
    'arc': {'common'},
    'standoff': {'common'},
    'accelerometer': {'common'},
    'machine': {'common', 'link', 'gcode', 'motion', 'arc', 'standoff', 'accelerometer'},
}
Graph = dict[str, set[str]]  # 'room/file' -> what it uses


def circle(graph: Graph) -> str:
    """The first circle found, or ''."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return ' -> '.join(reversed(error.args[1]))
    return ''


def not_allowed(graph: Graph) -> list[str]:
    """Uses of a room that does not lie below."""
    pairs = [(a, b) for a, uses in sorted(graph.items()) for b in sorted(uses)]
    rooms = [(a, b, a.split('/')[0], b.split('/')[0]) for a, b in pairs]
    return [
        f'{a} uses {b}' for a, b, own, other in rooms if own != other and other not in BELOW[own]
    ]


def includes() -> Graph:
    """Headers and sources are one module each here: waam_arc.c and waam_arc.h are arc/waam_arc."""
    files = sorted(CORE.glob('*/*.[ch]'))
    where = {f.name: f'{f.parent.name}/{f.name}' for f in files}
    return {
        where[f.name]: {
            where[name]
            for name in re.findall(r'#include "(\w+\.h)"', f.read_text())
            if name in where
        }
        for f in files
    }


def calls(objects: Path) -> Graph:
    """From the symbols that each object file defines and leaves open."""
    defined: dict[str, str] = {}
    wanted: Graph = {}
    for file in sorted(objects.glob('*/*.o')):
        name = f'{file.parent.name}/{file.name.split(".")[0]}'
        table = subprocess.run(['nm', str(file)], capture_output=True, text=True, check=True).stdout
        wanted[name] = set(re.findall(r'^ +U (\w+)$', table, re.MULTILINE))
        defined |= dict.fromkeys(re.findall(r'^\w+ [TDRBC] (\w+)$', table, re.MULTILINE), name)
    return {
        name: {defined[s] for s in symbols if s in defined} - {name}
        for name, symbols in wanted.items()
    }


@pytest.fixture(scope='module')
def object_files(tmp_path_factory) -> Path:
    """Compiled for this test alone, so that nothing old lies among them."""
    if not shutil.which('gcc') or not shutil.which('nm'):
        pytest.skip('gcc and nm are needed')
    folder = tmp_path_factory.mktemp('objects')
    paths = [f'-I{CORE / room}' for room in BELOW]
    for room in BELOW:
        (folder / room).mkdir()
        sources = [str(f) for f in sorted((CORE / room).glob('*.c'))]
        if sources:
            subprocess.run(
                ['gcc', '-std=c11', '-O0', '-c', *paths, *sources], cwd=folder / room, check=True
            )
    return folder


def test_every_source_lies_in_a_room():
    assert {f.name for f in CORE.iterdir() if f.is_dir()} == set(BELOW)
    assert not list(CORE.glob('*.[ch]'))
    rooms = re.search(r'WAAM_CORE_ROOMS (.*)\)', (CORE / 'rooms.cmake').read_text())
    assert set(rooms[1].split()) == set(BELOW)


def test_includes_go_down_only():
    graph = includes()
    assert not_allowed(graph) == []
    assert circle(graph) == ''


def test_calls_go_down_only_and_in_no_circle(object_files):
    graph = calls(object_files)
    assert len(graph) > 20 and graph['machine/waam_machine']
    assert not_allowed(graph) == []
    assert circle(graph) == ''


def test_states_lie_below_what_changes_them(object_files):
    """Hold, alarm and stop are called by many and call none of them."""
    graph = calls(object_files)
    assert not {f for f in graph['machine/waam_state'] if f.startswith('machine/')}
    users = {name for name, uses in graph.items() if 'machine/waam_state' in uses}
    assert users >= {f'machine/waam_{name}' for name in ('guard', 'run', 'orders', 'intake')}


def test_the_guards_find_what_they_are_for():
    good = {'arc/a': {'common/t'}, 'machine/m': {'arc/a'}}
    assert not_allowed(good) == [] and circle(good) == ''
    assert not_allowed(good | {'common/t': {'arc/a'}}) == ['common/t uses arc/a']
    assert circle(good | {'common/t': {'machine/m'}})
