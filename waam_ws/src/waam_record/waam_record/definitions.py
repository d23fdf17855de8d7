"""Message definitions as one text (`ros2msg`), so that a recording can be read without this
workspace.

The text of the type comes first, then each type it needs once, after a line of 80 `=` and `MSG:
package/Name`. Types of actions and services have no .msg file of their own; theirs is written from
the type description (.json) that rosidl installs beside them.
"""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

SEPARATOR = '=' * 80
_PRIMITIVES = [  # type_id 2..18 of type_description_interfaces/FieldType
    *('int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'int64', 'uint64'),
    *('float32', 'float64', 'float64', 'char', 'wstring', 'bool', 'byte', 'string', 'wstring'),
]
BUILTIN = frozenset((*_PRIMITIVES, 'wchar', 'time', 'duration'))
_NESTED, _BOUNDED_STRING, _BOUNDED_WSTRING = 1, 21, 22
_ARRAY, _BOUNDED, _UNBOUNDED = 48, 96, 144  # added to type_id for T[n], T[<=n], T[]


class DefinitionError(ValueError):
    """A type whose definition is not installed; the text names the type."""


def ament_prefixes() -> list[Path]:
    """The install prefixes of the environment, first one first."""
    return [Path(p) for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]


def full_text(type_name: str, prefixes: list[Path]) -> str:
    """Definition of `package/msg/Name` with everything it needs. Raises DefinitionError."""
    texts: dict[str, str] = {}
    _collect(type_name, prefixes, texts)
    root, *rest = texts.items()
    parts = [root[1].rstrip('\n') + '\n']
    parts += [f'{SEPARATOR}\nMSG: {_short(name)}\n{text.rstrip()}\n' for name, text in rest]
    return '\n'.join(parts)


def _collect(name: str, prefixes: list[Path], texts: dict[str, str]) -> None:
    if name not in texts:
        texts[name] = _own_text(name, prefixes)
        for needed in needs(texts[name], name.split('/')[0]):
            _collect(needed, prefixes, texts)


def needs(text: str, package: str) -> list[str]:
    """Full names of the types that fields of a definition use, in order, each once."""
    found: list[str] = []
    for line in text.splitlines():
        words = line.split('#', 1)[0].split()
        if len(words) < 2 or words[1].startswith('='):
            continue
        base = re.sub(r'(\[.*\])|(<=\d+)', '', words[0])
        if base in BUILTIN:
            continue
        parts = base.split('/')
        full = f'{package}/msg/{base}' if len(parts) == 1 else base
        full = f'{parts[0]}/msg/{parts[1]}' if len(parts) == 2 else full
        if full not in found:
            found.append(full)
    return found


def _short(name: str) -> str:
    """`std_msgs/msg/Header` -> `std_msgs/Header`, as in .msg files; action types keep their three
    parts."""
    package, kind, base = name.split('/')
    return f'{package}/{base}' if kind == 'msg' else name


def _own_text(name: str, prefixes: list[Path]) -> str:
    parts = name.split('/')
    if len(parts) != 3:
        raise DefinitionError(f"'{name}' is not a type name of the form package/msg/Name")
    package, kind, base = parts
    for prefix in prefixes:
        file = prefix / 'share' / package / kind / f'{base}.{kind}'
        if kind == 'msg' and file.is_file():
            return file.read_text(encoding='utf-8')
        described = prefix / 'share' / package / kind / f'{base.split("_")[0]}.json'
        if kind != 'msg' and described.is_file():
            return _described_text(name, json.loads(described.read_text(encoding='utf-8')))
    raise DefinitionError(
        f"no definition of '{name}' is installed (looked in {len(prefixes)} prefixes)"
    )


def _described_text(name: str, description: dict) -> str:
    message = description['type_description_msg']
    for one in (message['type_description'], *message['referenced_type_descriptions']):
        if one['type_name'] == name:
            lines = [f'{_field_type(f["type"])} {f["name"]}\n' for f in one['fields']]
            return ''.join(lines)
    raise DefinitionError(f"the installed description of '{name}' does not contain it")


def _field_type(field: dict) -> str:
    kind, capacity = field['type_id'], field['capacity']
    suffix = ''
    for offset, form in (
        (_UNBOUNDED, '[]'),
        (_BOUNDED, f'[<={capacity}]'),
        (_ARRAY, f'[{capacity}]'),
    ):
        if kind > offset:
            kind, suffix = kind - offset, form
            break
    if kind == _NESTED:
        return _short(field['nested_type_name']) + suffix
    if kind in (_BOUNDED_STRING, _BOUNDED_WSTRING):
        base = 'string' if kind == _BOUNDED_STRING else 'wstring'
        return f'{base}<={field["string_capacity"]}{suffix}'
    return _PRIMITIVES[kind - 2] + suffix
