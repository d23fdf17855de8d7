"""The cell file `cells/NAME.yaml`: every number of a cell. Parsed, compared, turned into parameters. Pure.

Units are in the names of the keys (`cell_keys`); parameters are SI. Errors name file, line, key and reason.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import yaml

from .cell_keys import (
    AXES,
    KEYS,
    MACHINE,
    NUMBER,
    PLATE,
    SECTIONS,
    SIZES,
    SWITCH,
    TEXT,
    WHOLE,
    WORK_ZERO,
    Key,
)

VERSION = 1
HEAD = 'waam_cell'  # key of the version
LIMIT = 200_000  # bytes of a file
LARGEST = 1e15  # of a number: beyond it whole ones are no floats any more
ALIKE = 1e-6  # relative: a value went through mm and back
Parameters = dict[str, dict[str, Any]]  # node -> parameter -> value
Point = tuple[float, float, float]


class CellError(ValueError):
    """A cell file that cannot be used: one line for everything that is wrong, each with file, line, key and reason."""


@dataclass(frozen=True)
class CellFile:
    """name: as the user calls the file; text: its content; values: by path, as written; lines: where they stand, from
    1; sha256: of the text."""

    name: str
    text: str
    values: dict[str, Any]
    lines: dict[str, int]

    @property
    def sha256(self) -> str:
        """Of the whole file."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @property
    def machine_sha256(self) -> str:
        """Of what the controller is told, whatever the file looks like: comments and other sections do not count."""
        told = {k: v for k, v in self.values.items() if k.startswith(MACHINE)}
        return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()

    def where(self, path: str) -> str:
        """`file:line: key`, for messages."""
        line = self.lines.get(path)
        return f'{self.name}:{line}: {path}' if line else f'{self.name}: {path}'

    def parameters(self, simulated: bool = False) -> Parameters:
        """What the file says, by node. simulated: only what a simulated cell is told; else nothing of that node."""
        found: Parameters = {}
        for path, value in self.values.items():
            key = KEYS[path]
            for node, name, told in _told(key, value):
                if (key.simulated or not simulated) and (simulated or node != 'cell'):
                    found.setdefault(node, {})[name] = told
        return found

    def key_of(self, node: str, parameter: str) -> str:
        """Path of the key that this parameter comes from, '' = the file says nothing of it."""
        return next((p for p in self.values if (node, parameter) in KEYS[p].parameters), '')

    def box(self, build: bool) -> tuple[Point, Point] | None:
        """Lower and upper corner of the reach in the work frame, m; None where the file does not say all of it."""
        sizes = [self.values.get(f'{AXES}{axis}.envelope_mm') for axis in 'xyz']
        zero, plate = self.values.get(WORK_ZERO), self.values.get(PLATE)
        if zero is None or None in sizes or (build and plate is None):
            return None
        at = [z + (p if build else 0.0) for z, p in zip(zero, plate or zero, strict=True)]
        low = tuple(-v * 1e-3 for v in at)
        high = tuple((s - v) * 1e-3 for s, v in zip(sizes, at, strict=True))
        return low, high

    def differences(
        self, parameters: Mapping[str, Mapping[str, Any]], simulated: bool
    ) -> dict[str, str]:
        """path -> why: keys that nodes do not have as the file says. parameters: what nodes have; those that are not
        there are not compared."""
        found: dict[str, str] = {}
        for node, wanted in self.parameters(simulated).items():
            for name, value in wanted.items():
                has = parameters.get(node, {}).get(name, value)
                if not alike(has, value):
                    path = self.key_of(node, name)
                    found.setdefault(
                        path, f'{self.where(path)} is {self.values[path]}, {node} has {name} {has}'
                    )
        return found


def _told(key: Key, value: Any) -> Iterator[tuple[str, str, Any]]:
    """Node, parameter, value in its unit."""
    if key.words:
        value = key.words[value]
    elif key.kind == NUMBER:
        value = _si(value, key)
    elif key.kind in SIZES:
        value = [_si(v, key) for v in value]
    split = key.kind in SIZES and key.section == 'process'  # two parameters, one for each end
    for k, (node, name) in enumerate(key.parameters):
        told = value[k] if split else value
        yield node, name, list(told) if isinstance(told, list) else told  # no two share one


def _si(value: float, key: Key) -> float:
    """Without the last digits that a factor adds: 0.82, not 0.8200000000000001."""
    return float(f'{value * key.factor:.12g}')


def alike(a: Any, b: Any) -> bool:
    """Whether two values of a parameter are the same, but for rounding."""
    if isinstance(b, list | tuple):
        same = isinstance(a, list | tuple) and len(a) == len(b)
        return same and all(alike(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(b, float) and isinstance(a, int | float):
        return math.isclose(a, b, rel_tol=ALIKE, abs_tol=1e-12)
    return bool(a == b)


def parse(text: str, name: str) -> CellFile:
    """name: for messages. CellError names everything that is not understood; limits are not looked at here."""
    cell = CellFile(name, text, {}, {})
    wrong: list[str] = []
    try:
        if len(text.encode()) > LIMIT:
            raise CellError(f'{name}: longer than {LIMIT} bytes')
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        if not isinstance(node, yaml.MappingNode):
            raise CellError(f'{name}: no cell file (waam cell new makes one)')
        version = _read(loader, node, '', cell, wrong)
    except yaml.YAMLError as e:
        mark = getattr(e, 'problem_mark', None)
        line = f':{mark.line + 1}' if mark else ''
        why = getattr(e, 'problem', None) or ' '.join(str(e).split())
        raise CellError(f'{name}{line}: no YAML ({why})') from None
    except (RecursionError, ValueError) as e:
        if isinstance(e, CellError):
            raise
        raise CellError(f'{name}: cannot be read ({type(e).__name__})') from None
    if version != VERSION:
        said = 'is missing' if version is None else f'is {version!r}'
        wrong.insert(0, f'{name}: {HEAD} {said}, must be {VERSION}: the version of this file')
    if wrong:
        raise CellError('\n'.join(wrong))
    return cell


def _read(
    loader: yaml.SafeLoader, node: yaml.MappingNode, above: str, cell: CellFile, wrong: list[str]
) -> Any:
    """Fills in values and lines; returns the version."""
    version, seen = None, set()
    for key_node, value_node in node.value:
        line = key_node.start_mark.line + 1
        name = str(key_node.value) if isinstance(key_node, yaml.ScalarNode) else '?'
        path = f'{above}{name}'
        here = f'{cell.name}:{line}: {path}'
        if name in seen:
            wrong.append(f'{here} is there twice')
        seen.add(name)
        if path == HEAD:
            version = loader.construct_object(value_node, deep=True)
        elif path in KEYS:
            value = loader.construct_object(value_node, deep=True)
            if why := _mismatch(KEYS[path], value):
                wrong.append(f'{here} is {value!r}: {why}')
            cell.values[path], cell.lines[path] = value, line
        elif any(known.startswith(f'{path}.') for known in KEYS):
            if isinstance(value_node, yaml.MappingNode):
                _read(loader, value_node, f'{path}.', cell, wrong)
            elif value_node.tag != 'tag:yaml.org,2002:null':  # a heading with nothing below it
                wrong.append(f'{here} holds no keys, wanted are {", ".join(_below(path))}')
        else:
            wrong.append(f'{here} is not known{_near(path, above)}')
    return version


def _mismatch(key: Key, value: Any) -> str:
    """Why the value is none of this key, '' = it is one."""
    if key.words:
        known = isinstance(value, str) and value in key.words
        return '' if known else f'wanted is {" or ".join(key.words)}'
    if key.kind in SIZES:
        right = isinstance(value, list) and len(value) == SIZES[key.kind]
        right = right and all(map(_number, value))
    elif key.kind == NUMBER:
        right = _number(value)
    elif key.kind == WHOLE:
        right = isinstance(value, int) and _number(value)
    else:
        right = isinstance(value, {TEXT: str, SWITCH: bool}[key.kind])
    unit = f' ({key.unit})' if key.unit else ''
    return '' if right else f'wanted is {key.kind}{unit}'


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST


def _below(path: str) -> list[str]:
    """Names one level below a heading, '' = the top."""
    start = len(path) + 1 if path else 0
    return list(
        dict.fromkeys(k[start:].split('.')[0] for k in KEYS if not path or k.startswith(f'{path}.'))
    )


def _near(path: str, above: str) -> str:
    known = _below(above.rstrip('.'))
    near = get_close_matches(path[len(above):], known, 1)  # fmt: skip
    return f'; did you mean {above}{near[0]}?' if near else f'; known are {", ".join(known)}'


def new(name: str) -> str:
    """The commented file of a new cell: the values of a controller that nobody has told anything."""
    lines = [
        f'# The cell {name}. waam cell check {name} looks for mistakes, waam cell show {name} shows what counts.',
        '# Read by waam up, plan, lab and job with --cell NAME. Units are in the names. What is not given, or has a #',
        '# before it, stays as controller and nodes have it.',
        f'{HEAD}: {VERSION}',
    ]
    open_: list[str] = []
    for key in KEYS.values():
        section = key.section.split('.')
        kept = _common(open_, section)
        for depth in range(kept, len(section)):
            if depth == 0:
                lines.append('')
                lines += [f'# {text}' for text in SECTIONS[section[0]].splitlines()]
            lines.append(f'{"  " * depth}{section[depth]}:')
        open_ = section
        unit = f' [{key.unit}]' if key.unit else ''
        mark = '' if key.given else '# '
        pad = '  ' * len(section)
        lines.append(f'{pad}{mark}{key.name}: {key.example}  # {key.meaning}{unit}')
    return '\n'.join(lines) + '\n'


def _common(a: list[str], b: list[str]) -> int:
    """How many of the first words are the same."""
    return next((k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))  # fmt: skip


def differing(a: CellFile, b: CellFile) -> list[tuple[str, Any, Any]]:
    """Key, value in a, value in b of what is not the same; None = not given there."""
    rows = ((path, a.values.get(path), b.values.get(path)) for path in KEYS)
    return [row for row in rows if row[1] != row[2]]
