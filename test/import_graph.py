"""Who imports whom in the workspace, and what a module does besides computing: read from the files, nothing is run.

`python test/import_graph.py [SOURCE_FOLDER]` prints the figures of docs/design.md.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

SRC = Path(__file__).resolve().parents[1] / 'waam_ws' / 'src'
ROS = re.compile(r'(rclpy|\w+_msgs|\w+_srvs|\w+_interfaces|ament_index_python|rosidl_\w+)(\.|$)')
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
    is_package: bool

    @property
    def package(self) -> str:
        return self.name.split('.')[0]

    @property
    def room(self) -> str:
        """The sub-package that it lies in, or the module itself at the top of its package."""
        return '.'.join(self.name.split('.')[:2])


def parse_workspace(source: Path) -> dict[str, Module]:
    """All modules of the Python packages (package.xml beside a folder of the same name) below `source`."""
    found = {}
    for package in sorted(p.parent for p in source.glob('*/package.xml')):
        for file in sorted((package / package.name).glob('**/*.py')):
            parts = list(file.relative_to(package).with_suffix('').parts)
            is_package = parts[-1] == '__init__'
            name = '.'.join(parts[:-1] if is_package else parts)
            tree = ast.parse(file.read_text(), str(file))
            where = str(file.relative_to(source))
            found[name] = Module(name, where, tree, is_package)
    return found


def imported(module: Module) -> Iterator[str]:
    """Dotted names of everything imported anywhere in the file: in functions and under TYPE_CHECKING, too."""
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = _base(module, node)
            yield from (f'{base}.{alias.name}' for alias in node.names)


def _base(module: Module, node: ast.ImportFrom) -> str:
    if not node.level:
        return node.module or ''
    parts = module.name.split('.')
    keep = len(parts) - node.level + (1 if module.is_package else 0)
    return '.'.join([*parts[:keep], *([node.module] if node.module else [])])


@dataclass
class Workspace:
    """The packages below a source folder."""

    source: Path

    @cached_property
    def modules(self) -> dict[str, Module]:
        return parse_workspace(self.source)

    @cached_property
    def imports(self) -> dict[str, set[str]]:
        """Module -> modules of the workspace that it imports."""
        return {n: self._own(n) for n in self.modules}

    def _own(self, name: str) -> set[str]:
        found = {self._module_of(target) for target in imported(self.modules[name])}
        return {t for t in found if t and t != name}

    def _module_of(self, target: str) -> str:
        """The module that a dotted name stands for or lies in; '' when it is not of the workspace."""
        while target and target not in self.modules:
            target = target.rpartition('.')[0]
        return target

    def between(self, key: Callable[[Module], str]) -> dict[str, set[str]]:
        """The graph of groups of modules."""
        graph: dict[str, set[str]] = defaultdict(set)
        for name, targets in self.imports.items():
            own = key(self.modules[name])
            graph[own] |= {key(self.modules[t]) for t in targets} - {own}
        return dict(graph)

    def circles(self) -> dict[str, list[list[str]]]:
        """Circles between files, rooms and packages; those of rooms without those that are files only."""
        files = circles(self.imports)
        rooms = circles(self.between(lambda m: m.room))
        return {
            'files': files,
            'rooms': [c for c in rooms if c not in files],
            'packages': circles(self.between(lambda m: m.package)),
        }

    def used_packages(self) -> dict[str, set[str]]:
        """Package -> waam packages that it imports, whether they are in the workspace or not."""
        used: dict[str, set[str]] = defaultdict(set)
        for m in self.modules.values():
            names = {target.split('.')[0] for target in imported(m)}
            used[m.package] |= {n for n in names if n.startswith('waam_')} - {m.package}
        return dict(used)

    def declared(self, package: str) -> set[str]:
        """What package.xml depends on at run time."""
        text = (self.source / package / 'package.xml').read_text()
        return set(re.findall(r'<(?:exec_depend|depend)>(\w+)<', text))

    @cached_property
    def know_ros(self) -> set[str]:
        """Modules that import ROS, or something that does."""
        knowing = {n for n, m in self.modules.items() if any(map(ROS.match, imported(m)))}
        while True:
            more = {n for n, targets in self.imports.items() if targets & knowing} - knowing
            if not more:
                return knowing
            knowing |= more


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Strongly connected groups of two and more (Tarjan 1972), each sorted."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for target in sorted(graph.get(node, ())):
            if target not in index:
                visit(target)
                low[node] = min(low[node], low[target])
            elif target in stack:
                low[node] = min(low[node], index[target])
        if low[node] == index[node]:
            at = stack.index(node)
            group, stack[at:] = stack[at:], []
            if len(group) > 1:
                found.append(sorted(group))

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return sorted(found)


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


# ---- figures ---------------------------------------------------------------------------------


def largest_flat_folder(source: Path) -> tuple[int, str]:
    """Most modules in one folder, tests aside."""
    folders: dict[Path, int] = defaultdict(int)
    for package in (p.parent for p in source.glob('*/package.xml')):
        for file in (package / package.name).glob('**/*.py'):
            folders[file.parent] += 1
    folder, count = max(folders.items(), key=lambda kv: kv[1])
    return count, str(folder.relative_to(source))


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


def main() -> None:
    source = Path(sys.argv[1]) if len(sys.argv) > 1 else SRC
    workspace = Workspace(source)
    for kind, found in workspace.circles().items():
        print(f'circles between {kind}: {len(found)}')
        for circle in found:
            print('   ', ' '.join(circle))
    count, folder = largest_flat_folder(source)
    print(f'largest flat folder: {count} modules in {folder}')
    count, where = longest_call({m.file: m.tree for m in workspace.modules.values()})
    print(f'longest call: {count} positional arguments in {where}')


if __name__ == '__main__':
    main()
