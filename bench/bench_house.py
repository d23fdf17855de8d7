"""The tree itself: how much there is to carry. Baseline: commit 986bae11, read from the history of git.

house.lines: lines of product and bench (.py .c .h .js .html .css .cpp .sh), without tests, docs and what is built;
house.test_lines: the same of folders called test or tests;
house.settings: parameters of nodes: the names with a value below `ros__parameters` in config/*.yaml of the packages.
Command-line options and files of materials and cells are not counted.
By package on stderr.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tarfile
from collections import Counter
from collections.abc import Iterator
from pathlib import PurePosixPath

import yaml
from lib.before import BEFORE, git
from lib.emit import emit
from lib.paths import ROOT

KINDS = {'.py', '.c', '.h', '.js', '.html', '.css', '.cpp', '.sh'}
TESTS = {'test', 'tests'}
ELSEWHERE = {'build', 'install', 'log', 'jobs', 'shared', 'docs'}


def now() -> Iterator[tuple[PurePosixPath, bytes]]:
    """Files of the working tree that git knows."""
    for name in git('ls-files').splitlines():
        if (ROOT / name).is_file():
            yield PurePosixPath(name), (ROOT / name).read_bytes()


def before() -> Iterator[tuple[PurePosixPath, bytes]]:
    """Files of the former commit. RuntimeError where git does not have it."""
    git('cat-file', '-e', f'{BEFORE}^{{commit}}')
    packed = subprocess.run(['git', 'archive', BEFORE], cwd=ROOT, check=True, capture_output=True)
    with tarfile.open(fileobj=io.BytesIO(packed.stdout)) as tar:
        for member in tar:
            if member.isfile():
                yield PurePosixPath(member.name), tar.extractfile(member).read()


def count(files: Iterator[tuple[PurePosixPath, bytes]]) -> tuple[Counter, Counter, Counter]:
    """Lines of product and bench, lines of tests, settings; each by package."""
    lines, tests, settings = Counter(), Counter(), Counter()
    for path, content in files:
        folders = set(path.parts[:-1])
        package = path.parts[2 if path.parts[0] == 'waam_ws' and len(path.parts) > 3 else 0]
        if path.suffix in KINDS and not folders & ELSEWHERE:
            (tests if folders & TESTS else lines)[package] += content.count(b'\n')
        if path.parent.name == 'config' and path.suffix == '.yaml' and not folders & TESTS:
            settings[package] += parameters(yaml.safe_load(content))
    return lines, tests, settings


def parameters(given: object, inside: bool = False) -> int:
    """Names with a value below `ros__parameters`."""
    if not isinstance(given, dict):
        return int(inside)
    return sum(parameters(v, inside or k == 'ros__parameters') for k, v in given.items())


def house() -> None:
    """All of them."""
    today, former = count(now()), count(before())
    for name, found, old in zip(('lines', 'test_lines', 'settings'), today, former, strict=True):
        said = ', '.join(f'{package} {n}' for package, n in found.most_common())
        print(f'house.{name}: {said}', file=sys.stderr)
        emit(f'house.{name}', found.total(), name, f'commit {BEFORE}', old.total())


FIGURES = dict.fromkeys(('house.lines', 'house.test_lines', 'house.settings'), house)
