"""The names are those of the messages."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from waam_process import names
from waam_process.loop_mode import LOOP_MODES
from waam_process.operating import DEFAULT_MATERIAL

SOURCES = Path(__file__).parents[2]
MESSAGES = SOURCES / 'waam_msgs' / 'msg'
REPORTS = ('notice', 'note', 'Notice')  # (severity, class, text, ...)


def constants(message: str, prefix: str = '') -> dict[str, int]:
    text = (MESSAGES / f'{message}.msg').read_text()
    found = re.findall(rf'^uint8 {prefix}([A-Z_]+)=(\d+)', text, re.M)
    return {name: int(number) for name, number in found}


@pytest.mark.parametrize(
    'message,prefix,listed',
    [
        ('Telemetry', 'STATE_', names.CONTROLLER_STATES),
        ('JobStatus', '', names.JOB_STATES),
        ('Anomaly', '', names.SEVERITIES),
    ],
)
def test_states_are_the_constants_of_the_messages(message, prefix, listed):
    assert constants(message, prefix) == {name: i for i, name in enumerate(listed)}


@pytest.mark.parametrize(
    'message,field,listed',
    [
        ('Anomaly', 'class_name', names.ANOMALY_CLASSES),
        ('JobStatus', 'loop_mode', LOOP_MODES),
    ],
)
def test_words_are_those_that_the_message_lists(message, field, listed):
    text = (MESSAGES / f'{message}.msg').read_text()
    line = re.search(rf'^string {field}\s+# (.*)', text, re.M)
    assert line and tuple(line[1].split(', ')) == listed


LISTS = (
    names.CONTROLLER_STATES,
    names.JOB_STATES,
    names.SEVERITIES,
    names.ANOMALY_CLASSES,
    LOOP_MODES,
    names.FAULTS,
)


def lists_in(source: str) -> set[frozenset[str]]:
    """Every list, tuple or set of texts that is written out."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Tuple | ast.List | ast.Set):
            found.add(frozenset(text for e in node.elts for text in strings(e)))
        if isinstance(node, ast.Dict):  # a table from or to their numbers
            found.add(frozenset(text for e in node.keys if e for text in strings(e)))
            found.add(frozenset(text for e in node.values for text in strings(e)))
    return found


def test_no_other_module_writes_these_lists_out_again():
    wanted = {frozenset(names_) for names_ in LISTS}
    again = {
        str(f.relative_to(SOURCES))
        for f in SOURCES.glob('waam_*/waam_*/**/*.py')
        if f.name != 'names.py' and lists_in(f.read_text()) & wanted
    }
    assert again == set()


@pytest.mark.parametrize(
    'source',
    [
        "STATES = ['IDLE', 'RUN', 'HOLD', 'ALARM']",
        "STATES = {0: 'IDLE', 1: 'RUN', 2: 'HOLD', 3: 'ALARM'}",
        "NUMBER = {'ALARM': 3, 'HOLD': 2, 'RUN': 1, 'IDLE': 0}",
    ],
)
def test_a_list_that_is_written_out_again_is_found(source):
    assert frozenset(names.CONTROLLER_STATES) in lists_in(source)


@pytest.mark.parametrize(
    'words,home', [(LOOP_MODES, 'loop_mode'), ((DEFAULT_MATERIAL,), 'operating')]
)
def test_no_other_module_spells_these_words(words, home):
    spelled = {
        str(f.relative_to(SOURCES))
        for f in SOURCES.glob('waam_*/waam_*/**/*.py')
        for node in ast.walk(ast.parse(f.read_text()))
        if set(strings(node)) & set(words)
    }
    assert spelled == {f'waam_process/waam_process/{home}.py'}


def strings(node: ast.AST) -> list[str]:
    """The texts that an expression may be; none for one that is not written out."""
    if isinstance(node, ast.IfExp):
        return strings(node.body) + strings(node.orelse)
    return [node.value] if isinstance(node, ast.Constant) and isinstance(node.value, str) else []


def classes_in(source: str) -> list[str]:
    """Every anomaly class that is written out: in reports, as `class_name=`, in tables CLASS_OF."""
    found: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            name = getattr(node.func, 'attr', getattr(node.func, 'id', ''))
            if name in REPORTS and len(node.args) > 2:
                found += strings(node.args[1])
            for keyword in node.keywords:
                found += strings(keyword.value) if keyword.arg == 'class_name' else []
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict):
            table = any(getattr(t, 'id', '').startswith('CLASS_OF') for t in node.targets)
            found += [t for value in node.value.values for t in strings(value) if table]
    return found


def test_every_anomaly_has_a_class_of_the_list():
    """Of all packages; a class that is written down nowhere else is refused."""
    found = {
        path.relative_to(SOURCES).as_posix(): classes_in(path.read_text())
        for path in SOURCES.glob('waam_*/waam_*/**/*.py')
    }
    assert {'waam_bridge', 'waam_job', 'waam_scan'} <= {
        p.split('/')[0] for p, c in found.items() if c
    }
    unknown = {p: set(c) - set(names.ANOMALY_CLASSES) for p, c in found.items()}
    assert {p: c for p, c in unknown.items() if c} == {}


@pytest.mark.parametrize(
    'source',
    [
        "self.notice(1, 'weather', 'rain')",
        "Anomaly(class_name='weather')",
        "CLASS_OF = {204: 'weather'}",
        "x.note('FAULT', 'weather' if y else 'arc', z)",
    ],
)
def test_an_unknown_class_is_found(source):
    assert 'weather' in classes_in(source)


def test_a_number_without_a_name_is_shown_as_it_is():
    assert (names.controller_state(3), names.controller_state(7)) == ('ALARM', '7')
    assert (names.job_state(9), names.job_state(99)) == ('DONE', '99')
    assert 'PAUSED' in names.JOB_RUNNING and not set(names.JOB_ENDED) & set(names.JOB_RUNNING)
