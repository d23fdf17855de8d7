"""The READMEs of the packages say what the code says: parameters with their defaults and limits, names of topics."""

from __future__ import annotations

import math
import re

import pytest
import yaml
from code_names import ROOT, SRC

READMES = sorted(SRC.glob('*/README.md'))
ORDER = ('Features', 'Design', 'Parameters', 'Topics', 'Tuning')
IN_ORDER = (  # where the template is kept
    'adapt', 'bridge', 'bringup', 'firmware', 'job', 'lab', 'panel', 'plan', 'replay', 'robot', 'robot_bridge', 'view',
)  # fmt: skip
HEAD = '| parameter | default |'
ANY_NODE = {'/diagnostics', '/clock', 'heartbeat', 'lease_tick'}


def short(path):
    return str(path.relative_to(SRC))


def sections(text: str) -> dict[str, str]:
    """Text below each heading of the second level."""
    parts = re.split(r'^## +(.+)$', text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def documented(text: str) -> dict[str, str]:
    """Parameter -> default as the tables print it."""
    found, inside = {}, False
    for line in text.splitlines():
        inside = line.startswith(HEAD) or (inside and line.startswith('|'))
        cells = [c.strip().strip('`') for c in line.split('|')[1:-1]]
        if inside and re.fullmatch(r'[a-z]\w*(\.\w+)*', cells[0]) and cells[0] != 'parameter':
            found[cells[0]] = cells[1]
    return found


def flattened(values: dict, prefix: str = '') -> dict:
    """Nested parameters with dots."""
    out = {}
    for key, value in values.items():
        inner = flattened(value, f'{prefix}{key}.') if isinstance(value, dict) else {}
        out |= inner or {prefix + key: value}
    return out


def configured(package) -> dict:
    """Parameters of all nodes of a package with their defaults."""
    out = {}
    for file in sorted((package / 'config').glob('*.yaml')):
        for node in yaml.safe_load(file.read_text()).values():
            if isinstance(node, dict) and 'ros__parameters' in node:
                out |= flattened(node['ros__parameters'])
    return out


def alike(printed: str, value) -> bool:
    value = [] if value == [''] else value  # a file of ROS parameters cannot hold an empty list
    try:
        number = float(printed)
        return number == value or (math.isnan(number) and math.isnan(value))
    except (ValueError, TypeError):
        return printed == str(value) or yaml.safe_load(printed or "''") == value


WITH_TABLES = [r for r in READMES if HEAD in r.read_text()]


def test_there_are_tables_to_check():
    assert len(WITH_TABLES) >= 6


@pytest.mark.parametrize('readme', WITH_TABLES, ids=short)
def test_parameters_and_defaults_are_those_of_the_nodes(readme):
    wanted, told = configured(readme.parent), documented(readme.read_text())
    assert not sorted(set(wanted) ^ set(told))
    assert not {k: (told[k], wanted[k]) for k in wanted if not alike(told[k], wanted[k])}


@pytest.mark.parametrize('name', IN_ORDER)
def test_a_readme_keeps_the_order(name):
    heads = list(sections((SRC / f'waam_{name}' / 'README.md').read_text()))
    found = [next((i for i, h in enumerate(heads) if h.startswith(o)), -1) for o in ORDER]
    assert -1 not in found and found == sorted(found)


@pytest.mark.parametrize('readme', READMES, ids=short)
def test_topics_and_services_are_in_the_code(readme):
    """Names in code font below a heading 'Topics...' occur in the package's code; of `a/b` both parts."""
    code = '\n'.join(
        f.read_text() for f in [*readme.parent.rglob('*.py'), *readme.parent.rglob('*.yaml')]
    )
    text = ' '.join(t for h, t in sections(readme.read_text()).items() if h.startswith('Topics'))
    names = set(re.findall(r'`(/?[a-z_]+(?:/[a-z_]+)*)`', text)) - ANY_NODE
    words = {word for name in names for word in name.strip('/').split('/')}
    assert not sorted(w for w in words if not re.search(rf'\b{w}\b', code))


@pytest.mark.parametrize('readme', READMES, ids=short)
def test_modules_of_the_design_exist(readme):
    text = sections(readme.read_text()).get('Design', '')
    files = set(re.findall(r'`([\w/]+\.(?:py|js))`', text))
    there = [f'/{f.relative_to(ROOT)}' for folder in (SRC, ROOT / 'test', ROOT / 'bench')
             for f in folder.rglob('*.*')]  # fmt: skip
    assert not sorted(name for name in files if not any(f.endswith(f'/{name}') for f in there))
