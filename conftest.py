"""For all tests, those of the packages and those of the graph."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from waam_bringup.shared_memory import clean

# `make test` tries the same examples everywhere, so that it fails where its change is at fault. WAAM_EXAMPLES=random
# looks for new ones (and keeps those that fail).
_ANYWHERE = {'deadline': None, 'suppress_health_check': [HealthCheck.too_slow]}
settings.register_profile('same', derandomize=True, database=None, **_ANYWHERE)
settings.register_profile('random', **_ANYWHERE)
settings.load_profile(os.environ.get('WAAM_EXAMPLES', 'same'))


_LONG = Path(__file__).parent / 'test' / 'long_tests.txt'


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks what test/long_tests.txt names as `long`, so that `-m 'not long'` leaves it out."""
    names = [line.split(' | ')[0] for line in _LONG.read_text().splitlines() if ' | ' in line]
    for item in items:
        if any(
            item.nodeid == n or item.nodeid.startswith((f'{n}::', f'{n}[', f'{n}/')) for n in names
        ):
            item.add_marker('long')


@pytest.fixture(scope='module', autouse=True)
def no_shared_memory_of_the_dead() -> None:
    """Tests kill nodes, and each leaves 35 MB in /dev/shm. Where that is small, the next node would die of it."""
    clean()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Shows why a test is run once more: its second run may pass, and the reason would be lost."""
    if report.outcome == 'rerun':  # of pytest-rerunfailures
        print(f'\nRERUN {report.nodeid} ({report.when}):\n{report.longreprtext}')
        for title, text in report.sections:
            print(f'--- {title}\n{text}')
