"""What a module does besides computing, read from its file; nothing is run."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

CLOCK = {
    'time': {
        'time', 'time_ns', 'monotonic', 'monotonic_ns', 'perf_counter', 'perf_counter_ns',
        'process_time', 'sleep', 'localtime', 'gmtime', 'strftime',
    },
    'datetime': {'now', 'utcnow', 'today'},
    'date': {'today'},
}  # fmt: skip
IO_MODULES = {
    'socket', 'subprocess', 'shutil', 'tempfile', 'http', 'urllib', 'aiohttp', 'requests', 'serial',
    'mmap', 'select', 'sqlite3', 'fcntl', 'glob', 'gzip', 'zipfile',
}  # fmt: skip
IO_CALLS = {
    'open', 'read_text', 'read_bytes', 'write_text', 'write_bytes', 'unlink', 'mkdir', 'iterdir',
    'savez', 'savez_compressed', 'loadtxt', 'savetxt', 'genfromtxt',
}  # fmt: skip
NUMPY_IO = {'load', 'save'}


@dataclass(frozen=True)
class Module:
    """name: dotted; file: relative to the source folder, as printed; tree: its syntax."""

    name: str
    file: str
    tree: ast.Module

    @property
    def package(self) -> str:
        return self.name.split('.')[0]


def modules(source: Path) -> list[Module]:
    """Those of the Python packages (package.xml beside a folder of the same name) below `source`."""
    found = []
    for package in sorted(p.parent for p in source.glob('*/package.xml')):
        for file in sorted((package / package.name).glob('**/*.py')):
            parts = file.relative_to(package).with_suffix('').parts
            name = '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)
            tree = ast.parse(file.read_text(), str(file))
            found.append(Module(name, str(file.relative_to(source)), tree))
    return found


def impurities(module: Module) -> set[str]:
    """Which of 'clock' and 'io' the module does itself."""
    found = set()
    for node in ast.walk(module.tree):
        found |= _import_impurity(node) | _call_impurity(node)
    return found


def _import_impurity(node: ast.AST) -> set[str]:
    names: Iterable[str] = ()
    if isinstance(node, ast.Import):
        names = [alias.name.split('.')[0] for alias in node.names]
    elif isinstance(node, ast.ImportFrom) and not node.level:
        top = (node.module or '').split('.')[0]
        if top == 'time' and {alias.name for alias in node.names} & CLOCK['time']:
            return {'clock'}
        names = [top]
    return {'io'} if IO_MODULES & set(names) else set()


def _call_impurity(node: ast.AST) -> set[str]:
    """Attributes count without a call, too: `clock=time.monotonic` hands a clock on."""
    if isinstance(node, ast.Attribute):
        owner = node.value.id if isinstance(node.value, ast.Name) else _last(node.value)
        if node.attr in CLOCK.get(owner, ()):
            return {'clock'}
        if node.attr in IO_CALLS or (owner in ('np', 'numpy') and node.attr in NUMPY_IO):
            return {'io'}
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == 'open':
        return {'io'}
    return set()


def _last(node: ast.AST) -> str:
    return node.attr if isinstance(node, ast.Attribute) else ''


def longest_call(trees: Mapping[str, ast.Module]) -> tuple[int, str]:
    """Most positional arguments in a call, and where. trees: by the name that is printed.

    Functions of these trees that take any number of arguments (`*words`) do not count.
    """
    calls: list[tuple[int, str, int, str]] = []
    variadic = set()
    for file, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                calls.append((len(node.args), file, node.lineno, _called(node)))
            elif isinstance(node, ast.FunctionDef) and node.args.vararg:
                variadic.add(node.name)
    known = (c for c in calls if c[3] not in variadic)
    count, file, line, name = max(known, key=lambda c: c[0], default=(0, '', 0, ''))
    return count, f'{file}:{line} {name}'


def _called(call: ast.Call) -> str:
    return call.func.id if isinstance(call.func, ast.Name) else _last(call.func)
