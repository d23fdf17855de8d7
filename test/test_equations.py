"""docs/equations.md names functions and tests that exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SRC = ROOT / 'waam_ws' / 'src'
TEXT = (ROOT / 'docs' / 'equations.md').read_text()
FUNCTIONS = sorted(set(re.findall(r'`(waam_\w+(?:\.\w+){2,})`', TEXT)))
TESTS = sorted(set(re.findall(r'`(waam_\w+/test/\w+\.py)::(\w+)`', TEXT)))
C_FUNCTIONS = sorted(set(re.findall(r'`(waam_\w+/core/[\w/]+\.c): (\w+)`', TEXT)))


def names(source: str) -> set[str]:
    """Functions and classes of a module, methods as Class.method."""
    found = set()
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            found |= {f'{node.name}.{n.name}' for n in node.body if isinstance(n, ast.FunctionDef)}
    return found


def module_and_name(path: str) -> tuple[Path, str]:
    """The file of an import path and what is left of it behind the module."""
    parts = path.split('.')
    for cut in range(len(parts) - 1, 0, -1):
        file = SRC / parts[0] / Path(*parts[:cut]).with_suffix('.py')
        if file.exists():
            return file, '.'.join(parts[cut:])
    pytest.fail(f'{path}: no such module')


def test_the_page_has_what_it_promises():
    assert len(FUNCTIONS) > 20 and len(TESTS) > 20 and C_FUNCTIONS


@pytest.mark.parametrize('path', FUNCTIONS)
def test_function_exists(path):
    file, name = module_and_name(path)
    assert name in names(file.read_text()), f'{name} is not in {file.relative_to(SRC)}'


@pytest.mark.parametrize(('file', 'name'), TESTS)
def test_test_exists(file, name):
    assert name in names((SRC / file).read_text())


@pytest.mark.parametrize(('file', 'name'), C_FUNCTIONS)
def test_c_function_exists(file, name):
    assert re.search(rf'^\w.*\b{name}\(', (SRC / file).read_text(), re.MULTILINE)
