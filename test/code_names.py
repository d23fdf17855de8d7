"""Names of the code as the documentation writes them, and whether they exist; files are read, nothing is imported."""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
SRC = ROOT / 'waam_ws' / 'src'
C_NAME = re.compile(r'`(waam_firmware/[\w/]+\.c)(?:: (\w+))?`')
NAME = re.compile(r'`(waam_\w+(?:\.\w+){2,})`')


def names(source: str) -> set[str]:
    """Functions, classes and variables of a module, methods as Class.method."""
    found = set()
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            methods = (
                n for n in node.body if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)
            )
            found |= {f'{node.name}.{n.name}' for n in methods}
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AnnAssign):
            targets = [node.target]
        found |= {t.id for t in targets if isinstance(t, ast.Name)}
    return found


def module_and_name(path: str) -> tuple[Path, str] | None:
    """The file of an import path and what is left of it behind the module; None when there is no such module."""
    parts = path.split('.')
    for cut in range(len(parts), 0, -1):
        file = SRC / parts[0] / Path(*parts[:cut]).with_suffix('.py')
        if file.exists():
            return file, '.'.join(parts[cut:])
    return None


def exists(path: str) -> bool:
    """Whether an import path is a module, or a function, class, method or variable of one."""
    found = module_and_name(path)
    if found is None:
        return (SRC / path.split('.')[0] / Path(*path.split('.')) / '__init__.py').exists()
    file, name = found
    return not name or name in names(file.read_text())


def c_exists(file: str, name: str) -> bool:
    """Whether a C file below the source folder defines the function; without a name, whether the file is there."""
    if not (SRC / file).exists():
        return False
    return not name or bool(re.search(rf'^\w.*\b{name}\(', (SRC / file).read_text(), re.MULTILINE))
