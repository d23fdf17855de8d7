"""For all tests, those of the packages and those of the graph."""

from __future__ import annotations

import pytest


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Shows why a test is run once more: its second run may pass, and the reason would be lost."""
    if report.outcome == 'rerun':  # of pytest-rerunfailures
        print(f'\nRERUN {report.nodeid} ({report.when}):\n{report.longreprtext}')
        for title, text in report.sections:
            print(f'--- {title}\n{text}')
