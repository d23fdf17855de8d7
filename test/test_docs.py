"""The documentation names functions and files that exist, and says nothing that only insiders can find."""

from __future__ import annotations

import argparse
import dataclasses
import math
import re
import subprocess
import sys

import pytest
from code_names import C_NAME, NAME, ROOT, SRC, c_exists, exists
from test_readmes import configured

from waam_bringup.cli import build_parser
from waam_node import job_folder
from waam_plan.settings import PlanSettings

DOCS = ROOT / 'docs'
PAGES = sorted(
    [
        *DOCS.glob('*.md'),
        *DOCS.glob('releases/*.md'),
        *SRC.glob('*/doc/*.md'),
        ROOT / 'README.md',
        ROOT / 'CHANGELOG.md',
    ]
)
READMES = sorted((ROOT / 'waam_ws' / 'src').glob('*/README.md'))
PAST = {'CHANGELOG.md', 'upgrading.md', '0.3.0.md'}  # they name what is no longer there
LINK = re.compile(r'\[[^\]]*\]\(([^)\s]+)\)')
INSIDE = re.compile(
    r'\bspec \d|\bissue ["A-Z0-9]|\bof the (\w+ )?issue\b|\bsitting\b|\bitem \d', re.IGNORECASE
)


def short(path):
    return str(path.relative_to(ROOT))


def anchors(text: str) -> set[str]:
    """Anchors of the headings, as GitHub makes them."""
    heads = re.findall(r'^#+ +(.+)$', text, re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', head.lower()).replace(' ', '-') for head in heads}


def test_the_overview_names_what_it_talks_about():
    text = (ROOT / 'docs' / 'code_overview.md').read_text()
    assert len(set(NAME.findall(text))) > 60
    assert len([name for _, name in C_NAME.findall(text) if name]) > 15


@pytest.mark.parametrize('page', [p for p in PAGES if p.name not in PAST], ids=short)
def test_functions_exist(page):
    text = page.read_text()
    missing = [name for name in sorted(set(NAME.findall(text))) if not exists(name)]
    missing += [f'{f}: {n}' for f, n in sorted(set(C_NAME.findall(text))) if not c_exists(f, n)]
    assert not missing


def test_a_name_that_does_not_exist_is_found():
    assert exists('waam_scan.stream.session.Session.add')
    assert not exists('waam_scan.stream.session.Session.nothing')
    assert not exists('waam_scan.nothing.at_all')
    assert c_exists('waam_firmware/core/motion/waam_motion.c', 'waam_motion_advance')
    assert not c_exists('waam_firmware/core/motion/waam_motion.c', 'waam_motion')


@pytest.mark.parametrize('page', [*PAGES, *READMES], ids=short)
def test_links_lead_somewhere(page):
    broken = []
    for target in LINK.findall(page.read_text()):
        if '://' in target:
            continue
        path, _, anchor = target.partition('#')
        file = (page.parent / path).resolve() if path else page
        if not file.exists() or (anchor and anchor not in anchors(file.read_text())):
            broken.append(target)
    assert not broken


def test_nothing_that_only_insiders_can_find():
    files = subprocess.run(
        ['git', 'ls-files', '*.md', '*.c', '*.h', '*.py', ':!test/test_docs.py'],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.split()  # fmt: skip
    found = [
        f'{file}:{number}: {line.strip()}'
        for file in files
        for number, line in enumerate((ROOT / file).read_text().splitlines(), 1)
        if INSIDE.search(line)
    ]
    assert not found


def section(file, anchor: str) -> str:
    """The text of a file below a heading, up to the next one of any level; the whole file without an anchor."""
    text = file.read_text()
    if not anchor:
        return text
    parts = re.split(r'^(?=#+ )', text, flags=re.MULTILINE)
    return next(part for part in parts if anchor in anchors(part))


def newcomers_questions() -> list[tuple[str, str, str]]:
    text = section(ROOT / 'docs' / 'README.md', 'where-do-i-find-')
    rows = [
        [cell.strip() for cell in line.split('|')[1:-1]]
        for line in text.splitlines()
        if '?' in line
    ]
    return [(row[0], row[1], LINK.findall(row[2])[0]) for row in rows if len(row) == 3]


def test_the_newcomer_has_questions():
    assert len(newcomers_questions()) >= 6


@pytest.mark.parametrize(('question', 'answer', 'link'), newcomers_questions())
def test_what_a_newcomer_asks_is_behind_one_link(question, answer, link):
    path, _, anchor = link.partition('#')
    there = section(ROOT / 'docs' / path, anchor)
    words = re.findall(r'`([^`]+)`', answer)
    assert words and any(w in there for w in words)
    assert words[-1] in there


def test_the_page_of_the_job_folder_names_every_file():
    """The first block of the page lists what the code calls its files; numbers and wildcards aside."""
    listed = (ROOT / 'docs' / 'job_folder.md').read_text().split('```')[1]
    names = [v for k, v in vars(job_folder).items() if k.isupper() and isinstance(v, str)]
    made = [job_folder.plan(), job_folder.program(), job_folder.record(), job_folder.resume(2),
            job_folder.plan(2), job_folder.map_after(0), job_folder.viewer_recording(), job_folder.cell()]  # fmt: skip
    wanted = [n for n in (*names, *made) if '*' not in n]
    assert len(wanted) > 18 and not [n for n in wanted if n not in listed]


STATED = re.compile(
    r'`(\w+)` \((-?[\d.]+) ?(%|mm|m|s|°)?\)|^\| `(\w+)` \| (-?[\d.]+) ?(%|mm|m|s|°)?', re.MULTILINE
)
UNIT = {'%': 0.01, 'mm': 1e-3, '°': math.pi / 180}


def defaults() -> dict[str, list]:
    """Parameters of all nodes and settings of the planner; some names belong to several nodes."""
    found: dict[str, list] = {f.name: [f.default] for f in dataclasses.fields(PlanSettings)}
    for package in SRC.iterdir():
        for name, value in configured(package).items():
            found.setdefault(name, []).append(value)
    return found


def wrong_defaults(text: str, known: dict[str, list]) -> list[str]:
    """Of `name` (0.5 mm) and of the rows of a table `setting | default`: values that are none of this name."""
    head = re.compile(r'\| (setting|parameter) \| default')
    text = re.sub(
        r'(^\|.*\n)+', lambda m: m[0] if head.match(m[0]) else '', text, flags=re.MULTILINE
    )
    wrong = []
    for match in STATED.finditer(text):
        name, number, unit = match.groups()[:3] if match[1] else match.groups()[3:]
        values = [v for v in known.get(name, ()) if isinstance(v, int | float)]
        if values and not any(math.isclose(v, float(number) * UNIT.get(unit, 1.0)) for v in values):
            wrong.append(f'{match[0]}: {values}')
    return wrong


def test_a_default_that_is_stale_is_found():
    known = {'wear_limit': [0.015], 'feed_floor': [0.42]}
    table = '| setting | default | why |\n|---|---|---|\n| `feed_floor` | 0.5 of the rate | x |\n'
    assert wrong_defaults('`wear_limit` (14 mm)', known) and wrong_defaults(table, known)
    assert not wrong_defaults('`wear_limit` (15 mm)' + table.replace('0.5', '0.42'), known)
    assert not wrong_defaults('| figure | value |\n|---|---|\n| `feed_floor` | 3 |\n', known)


@pytest.mark.parametrize('page', [p for p in PAGES if p.name not in PAST], ids=short)
def test_stated_defaults_are_those_of_the_parameter_files(page):
    assert not wrong_defaults(page.read_text(), defaults())


def test_every_figure_has_a_benchmark():
    names = re.findall(r'^\| `([\w.]+)` \|', (DOCS / 'figures.md').read_text(), re.MULTILINE)
    shown = subprocess.run(
        [sys.executable, ROOT / 'bench/run.py', 'help'], capture_output=True, text=True, check=True
    )
    known = set(shown.stdout.split())
    assert len(names) > 20 and not [n for n in names if n not in known]


MARKDOWN = [
    ROOT / name
    for name in subprocess.run(
        ['git', 'ls-files', '*.md', ':!*/models/*'],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.split()
]  # fmt: skip
NO_PROSE = re.compile(r' *(\||#|<|\[[^\]]+\]:|!\[)|    ')  # tables, headings, HTML, pictures, code
WIDEST = 120  # columns


def unwrapped(text: str) -> list[str]:
    """Lines of prose that are too long and could be broken; code spans and links cannot."""
    text = re.sub(r'^ *```.*?^ *```', '', text, flags=re.MULTILINE | re.DOTALL)
    long = [s for s in text.splitlines() if len(s) > WIDEST and not NO_PROSE.match(s)]
    return [s for s in long if ' ' in re.sub(r'`[^`]*`', '', LINK.sub('', s)).strip(' -')]


def test_prose_that_is_too_long_is_found():
    words = 'word ' * 30
    assert unwrapped(f'short\n{words}\n') == [words]
    assert not unwrapped(f'| {words} |\n```\n{words}\n```\n- `{words}`\n')


@pytest.mark.parametrize('page', MARKDOWN, ids=short)
def test_prose_is_wrapped(page):
    assert not unwrapped(page.read_text())


# ---- commands ------------------------------------------------------------------------------

COMMAND = re.compile(r'(?<![\w/.-])(?:\./)?waam ((?:[a-z][\w-]*)(?: [^`\n|]*)?)')
COMMANDS = build_parser()


def unknown_in(command: str) -> list[str]:
    """Verbs and options of `waam COMMAND` that it does not have."""
    words = re.sub(r'\s#.*|  .*', '', command).split()
    parser = COMMANDS
    while words and (verbs := verbs_of(parser)) and re.fullmatch(r'[a-z][a-z-]*', words[0]):
        if words[0] not in verbs:
            return [words[0]]
        parser = verbs[words.pop(0)]
    options = {w.split('=')[0].rstrip('.,;:)]') for w in words if re.match(r'\[?--[a-z]', w)}
    return sorted(o for o in (o.lstrip('[') for o in options) if o not in options_of(parser))


def verbs_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    found = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return dict(found[0].choices) if found else {}


def options_of(parser: argparse.ArgumentParser) -> set[str]:
    return {o for a in parser._actions for o in a.option_strings}


def commands_in(text: str) -> list[str]:
    """Of blocks of code and of code within a line."""
    blocks = re.findall(r'^```\w*\n(.*?)^```', text, re.M | re.S)
    inline = re.findall(r'`([^`\n]+)`', re.sub(r'^```.*?^```', '', text, flags=re.M | re.S))
    return [m for code in [*blocks, *inline] for m in COMMAND.findall(code)]


def test_a_command_that_does_not_exist_is_found():
    assert unknown_in('calibrate arc') == ['arc']
    assert unknown_in('view job.mcap --follow') == ['--follow']
    assert unknown_in('job run part.stl --as-found worn.stl  # a comment --no') == []


@pytest.mark.parametrize('page', [p for p in [*PAGES, *READMES] if p.name not in PAST], ids=short)
def test_commands_exist(page):
    wrong = {c: w for c in commands_in(page.read_text()) if (w := unknown_in(c))}
    assert not wrong


def test_make_docs_makes_a_site_without_broken_links(tmp_path):
    script = ROOT / 'scripts' / 'docs_site.py'
    done = subprocess.run(
        [sys.executable, script, tmp_path], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    home, search = (tmp_path / n for n in ('index.html', 'search/search_index.json'))
    assert 'waam_panel' in home.read_text() and 'unrolled' in search.read_text()
