"""make bench [ONLY=name]: what runs for which name; what a benchmark started is ended, whatever happens."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import json
import sys
from pathlib import Path

import pytest

BENCH = Path(__file__).parents[1] / 'bench'
MODULE = """
from functools import partial
RAN = []
def fast(): RAN.append('fast')
def slow(): RAN.append('slow')
def table(): RAN.append('table')
def broken(): raise RuntimeError('it broke')
def named(name): RAN.append(name)
FIGURES = {'link.fast_ms': fast, 'link.fast_us': fast, 'shape.slow_s': slow}
TABLES = {'link.table': table}
"""


def load_run():
    spec = importlib.util.spec_from_file_location('bench_run', BENCH / 'run.py')
    module = importlib.util.module_from_spec(spec)
    sys.modules['bench_run'] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def run():
    return load_run()


@pytest.fixture
def folder(tmp_path):
    (tmp_path / 'bench_one.py').write_text(MODULE)
    return tmp_path


def ran(run, folder, *arguments):
    """Exit status, and what of bench_one has run."""
    status = run.main(list(arguments), folder)
    return status, sys.modules['bench_one'].RAN


@pytest.mark.parametrize(
    'asked,expected',
    [
        ('', ['fast', 'slow']),
        ('link', ['fast']),
        ('link.fast_us', ['fast']),
        ('shape', ['slow']),
        ('shape.slow_s', ['slow']),
        ('link.table', ['table']),
    ],
)
def test_only_what_was_asked_for_runs(run, folder, asked, expected):
    assert ran(run, folder, *([asked] if asked else [])) == (0, expected)


@pytest.mark.parametrize('asked', ['lin', 'link.fast', 'link.', 'fast_ms', 'bench_one'])
def test_an_unknown_name_runs_nothing_and_lists_the_names(run, folder, asked, capsys):
    assert ran(run, folder, asked) == (2, [])
    said = capsys.readouterr().err
    assert f"'{asked}'" in said
    assert all(name in said for name in ('link.fast_ms', 'shape.slow_s', 'link.table'))


@pytest.mark.parametrize('asked', ['help', '--list'])
def test_the_names_are_listed(run, folder, asked, capsys):
    assert ran(run, folder, asked) == (0, [])
    assert capsys.readouterr().out.split() == [
        'link.fast_ms',
        'link.fast_us',
        'shape.slow_s',
        'link.table',
    ]


def test_a_failure_is_told_and_does_not_stop_the_others(run, folder, capsys):
    text = MODULE.replace("'link.fast_ms': fast", "'link.fast_ms': broken")
    (folder / 'bench_one.py').write_text(text)
    assert ran(run, folder) == (1, ['fast', 'slow'])
    assert 'it broke' in capsys.readouterr().err


def test_a_measurement_may_be_a_partial_function(run, folder, capsys):
    """What took how long is told after it has run: that must not end the others."""
    text = MODULE.replace("'link.fast_ms': fast", "'link.fast_ms': partial(named, 'rail')")
    (folder / 'bench_one.py').write_text(text)
    assert ran(run, folder) == (0, ['rail', 'fast', 'slow'])
    assert 'named took' in capsys.readouterr().err


def test_two_figures_of_one_name_are_refused(run, folder):
    (folder / 'bench_two.py').write_text(MODULE)
    with pytest.raises(ValueError, match='bench_two.py: two benchmarks are called link.fast_ms'):
        run.load(folder)


def test_the_benchmarks_of_this_repository_say_what_they_print(run):
    run.load(BENCH)
    for file in BENCH.glob('bench_*.py'):
        module = sys.modules[file.stem]
        for name in (*module.FIGURES, *getattr(module, 'TABLES', ())):
            assert name in module.__doc__, f'{file.name} does not describe {name}'


@pytest.mark.parametrize('file', sorted(BENCH.rglob('*.py')), ids=lambda f: f.name)
def test_what_a_benchmark_imports_when_it_runs_is_there(file):
    """Most of it is imported in functions, so that the list of figures comes at once: nothing else would notice."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('waam_'):
            module = importlib.import_module(node.module)
            for name in (alias.name for alias in node.names):
                there = hasattr(module, name) or importlib.util.find_spec(f'{node.module}.{name}')
                assert there, f'{node.module} has no {name}'


def test_figures_of_simulated_cells_name_their_preset(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(BENCH))
    from lib.emit import emit
    from lib.jaw import jaw_job
    from lib.preset import emit_on_cell, preset

    monkeypatch.delenv('WAAM_BENCH_PRESET', raising=False)
    assert preset() == jaw_job().preset == 'gentle' and preset('recorded') == 'recorded'
    monkeypatch.setenv('WAAM_BENCH_PRESET', 'rough')
    assert preset('recorded') == jaw_job().preset == 'rough'
    assert jaw_job(preset='gentle').preset == 'gentle'
    emit_on_cell('a.b', 1.0, '', 'base', None)
    emit('a.c', 1.0, '', 'base', None)
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert first['preset'] == 'rough' and 'preset' not in second
    monkeypatch.setenv('WAAM_BENCH_PRESET', 'wild')
    with pytest.raises(SystemExit, match="WAAM_BENCH_PRESET: .*'wild'.*recorded"):
        preset()
