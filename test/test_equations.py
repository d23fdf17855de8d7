"""docs/equations.md names functions and tests that exist, and explains every equation that the code mentions."""

from __future__ import annotations

import re

import pytest
from code_names import ROOT, SRC, c_exists, exists, names

TEXT = (ROOT / 'docs' / 'equations.md').read_text()
FUNCTIONS = sorted(set(re.findall(r'`(waam_\w+(?:\.\w+){2,})`', TEXT)))
TESTS = sorted(set(re.findall(r'`(waam_\w+/test/\w+\.py)::(\w+)`', TEXT)))
C_FUNCTIONS = sorted(set(re.findall(r'`(waam_\w+/core/[\w/]+\.c): (\w+)`', TEXT)))
ROWS = [
    [cell.strip() for cell in line.strip('|').split(' | ')]
    for line in TEXT.splitlines()
    if line.startswith('|') and '::' in line
]
SOURCES = set(re.findall(r'^\| ([A-Z][A-Z\d])\b', TEXT, re.MULTILINE))
MENTION = re.compile(r'\b[Ee]qs?\.? (\d\.\d+)')  # "eq 2.17"
# What only the people of this project can look up: numbered items and sections of texts that are not in the repository.
INSIDERS = re.compile(
    r'\bspec \d|\bissue (?:\d|Arc\b)|[Ss]ources? \(?00\d[^|]{0,3} section|section 6\.\d of'
)
CODE = [
    f
    for folder in ('waam_ws/src', 'docs', 'bench', 'test', 'scripts')
    for f in sorted((ROOT / folder).rglob('*'))
    if f.suffix in ('.py', '.c', '.h', '.md', '.yaml', '.msg', '.srv', '.action', '.js')
    and f.name not in ('equations.md', 'test_equations.py')
]


def mentioned() -> dict[str, str]:
    """Number of an equation -> a file that mentions it."""
    return {
        number: str(f.relative_to(ROOT)) for f in CODE for number in MENTION.findall(f.read_text())
    }


def explained(number: str) -> bool:
    """Whether a number of source 000 stands on the page, alone or inside a range such as 2.20–2.22."""
    ranges = re.findall(r'(\d)\.(\d+)–\d\.(\d+)', TEXT)
    whole, part = (int(x) for x in number.split('.'))
    return number in TEXT or any(int(a) == whole and int(b) <= part <= int(c) for a, b, c in ranges)


def test_the_page_has_what_it_promises():
    assert len(FUNCTIONS) > 60 and len(TESTS) > 60 and len(C_FUNCTIONS) > 8
    assert len(ROWS) > 60 and len(SOURCES) > 15


@pytest.mark.parametrize('row', ROWS, ids=[row[0] for row in ROWS])
def test_a_row_has_formula_units_function_and_test(row):
    assert len(row) == 5 and all(row)
    assert FUNCTIONS_OR_C.search(row[3]) and '::' in row[4]


FUNCTIONS_OR_C = re.compile(r'`waam_\w+(?:\.\w+){2,}`|`waam_firmware/core/[\w/]+\.c: \w+`')


@pytest.mark.parametrize('row', ROWS, ids=[row[0] for row in ROWS])
def test_a_citation_is_in_the_list_of_sources(row):
    short = re.findall(r'\b(?:S\d|[A-Z]{2})\b', row[0].split(' (')[0])
    assert set(short) <= SOURCES


@pytest.mark.parametrize('path', FUNCTIONS)
def test_function_exists(path):
    assert exists(path)


@pytest.mark.parametrize(('file', 'name'), TESTS)
def test_test_exists(file, name):
    assert name in names((SRC / file).read_text())


@pytest.mark.parametrize(('file', 'name'), C_FUNCTIONS)
def test_c_function_exists(file, name):
    assert c_exists(file, name)


def test_every_equation_that_the_code_mentions_is_explained():
    found = mentioned()
    assert len(found) > 8
    assert not {n: f for n, f in found.items() if not explained(n)}


def test_nothing_refers_to_what_only_insiders_can_find():
    assert not [str(f.relative_to(ROOT)) for f in CODE if INSIDERS.search(f.read_text())]
