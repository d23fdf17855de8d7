"""Objects of a JSON file as dataclasses: taken field by field by the types of their annotations, or refused. Pure."""

from __future__ import annotations

import sys
from dataclasses import fields
from typing import Any, TypeVar

Row = TypeVar('Row')
KINDS: dict[str, Any] = {
    'bool': bool, 'int': int, 'float': (int, float), 'str': str, 'dict': dict, 'list': list,
}  # fmt: skip


class RowError(ValueError):
    """Not such an object; the text names the field."""


def row_of(kind: type[Row], row: Any) -> Row:
    """The dataclass of an object that has exactly its fields. Raises RowError."""
    if not isinstance(row, dict):
        raise RowError('an object is wanted')
    known = {f.name: str(f.type) for f in fields(kind)}  # type: ignore[arg-type]
    if wrong := sorted(map(str, set(row) ^ set(known))):
        raise RowError(f'missing or unknown: {", ".join(wrong)[:80]}')
    for name, annotation in known.items():
        if not fits(row[name], annotation):
            raise RowError(f'{name} is no {annotation}')
    return kind(**row)


def fits(value: Any, annotation: str) -> bool:
    """Whether a value is of this type: 'float' is finite, 'dict[str, int]' has whole numbers, True is no number."""
    kind, _, none = annotation.partition(' | ')
    if value is None or isinstance(value, bool):
        return none == 'None' if value is None else kind == 'bool'
    if not isinstance(value, KINDS[kind.partition('[')[0]]):
        return False
    if kind == 'float':
        return -sys.float_info.max <= value <= sys.float_info.max
    if kind == 'dict[str, int]':
        return all(fits(v, 'int') for v in value.values())
    return True
