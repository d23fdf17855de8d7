"""Parameter files that say nothing about the node that got them. rcl passes over them without a word."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import yaml

from .params import ParameterError

MAX_BYTES = 1_000_000


def files_in(arguments: Sequence[str]) -> list[Path]:
    """Files that follow --params-file after --ros-args in a command line."""
    found, ros = [], False
    for before, word in zip(['', *arguments], arguments, strict=False):
        if word in ('--ros-args', '--'):
            ros = word == '--ros-args'
        elif ros and before == '--params-file':
            found.append(Path(word))
    return found


def matches(key: str, node: str) -> bool:
    """Whether the block `key` of a parameter file is for the node of this full name, by the rules of rcl: * is one
    part of a name, ** any number of them."""
    parts = ['' if part == '**' else part for part in key.strip('/').split('/')]
    pattern = ''.join(
        r'(/\w+)*' if not p else '/' + re.escape(p).replace(r'\*', r'\w+') for p in parts
    )
    return re.fullmatch(pattern, node) is not None


def check(files: Iterable[Path], node: str) -> None:
    """node: full name, /namespace/name. ParameterError where a block is for this node in another namespace, or where no
    file has a block for it: its values would be passed over."""
    name = node.rpartition('/')[2]
    seen: list[str] = []
    found = False
    for file in files:
        keys = _keys(file)
        for key in keys:
            if key.rpartition('/')[2] == name and not matches(key, node):
                raise ParameterError(
                    f"{file}: '{key}' is not for the node {node}: write '/**/{name}', or '{node}', in its place"
                )
        seen += [f'{k} ({file.name})' for k in keys]
        found = found or any(matches(key, node) for key in keys)
    if seen and not found:
        raise ParameterError(
            f'no parameter file has a block for the node {node}: {", ".join(seen)}'
        )


def _keys(file: Path) -> list[str]:
    """Blocks of a file; what cannot be read is left to rcl, which refuses it."""
    try:
        data = yaml.safe_load(file.read_bytes()[:MAX_BYTES])
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return []
    return _blocks(data, '') if isinstance(data, dict) else []


def _blocks(data: dict, above: str) -> list[str]:
    """Names of blocks; a namespace may hold nodes: cell2: {bridge: {ros__parameters: …}}."""
    found = []
    for key, value in data.items():
        whole = f'{above}/{str(key).strip("/")}' if above else str(key)
        inner = (
            {k: v for k, v in value.items() if k != 'ros__parameters'}
            if isinstance(value, dict)
            else {}
        )
        nested = {k: v for k, v in inner.items() if isinstance(v, dict)}
        if nested and 'ros__parameters' not in value:
            found += _blocks(nested, whole)
        else:
            found.append(whole)
    return found
