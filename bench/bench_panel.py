"""The operator's page in a real browser.

panel.axe_violations: of WCAG 2.2 AA and of what must not be cut, on every page of a panel without a cell, in both
themes and at three widths (baseline: pages looked at); axe-core is no dependency, the checks are those of
waam_panel/test/page_checks.js.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

from lib.emit import emit
from lib.node import NodeUnderTest

PATIENCE_MS = 60_000


@contextmanager
def browser():
    """A Chromium."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        path = shutil.which('chromium') or shutil.which('google-chrome')
        made = p.chromium.launch(executable_path=path, args=['--no-sandbox'])
        yield made
        made.close()


def open_page(context, url: str):
    """The page *Set up* of a panel that is just starting."""
    from playwright.sync_api import Error

    page, end = context.new_page(), time.monotonic() + 60
    page.set_default_timeout(PATIENCE_MS)
    while True:
        try:
            page.goto(url)
            break
        except Error:
            if time.monotonic() > end:
                raise
            time.sleep(0.2)
    page.click('nav [data-page=setup]')
    page.wait_for_selector('#f-tolerance_mm[data-high]')
    page.wait_for_selector('#load:enabled')
    return page


CHECKS = Path(__file__).parents[1] / 'waam_ws' / 'src' / 'waam_panel' / 'test' / 'page_checks.js'
SIZES = ((1366, 768), (1024, 768), (390, 844))


def axe_violations() -> None:
    from waam_bringup.operate import free_port

    checks, found, looked = CHECKS.read_text(), 0, 0
    with tempfile.TemporaryDirectory() as folder, browser() as chromium:
        port = free_port()
        address = f'http://127.0.0.1:{port}/'
        with NodeUnderTest('waam_panel.panel_node', f'port:={port}', f'jobs_dir:={folder}'):
            for theme in ('light', 'dark'):
                for width, height in SIZES:
                    size = {'width': width, 'height': height}
                    context = chromium.new_context(color_scheme=theme, viewport=size)
                    page = open_page(context, address)
                    names = page.eval_on_selector_all(
                        'nav [data-page]', 'all => all.map((b) => b.dataset.page)'
                    )
                    for name in (*names, 'cells'):
                        if name == 'cells':
                            page.goto(f'{address}cells')
                            page.wait_for_selector('#cards .card')
                        else:
                            page.click(f'nav [data-page={name}]')
                        looked += 1
                        for said in page.evaluate(checks):
                            found += 1
                            print(f'{theme} {width} {name}: {said}', file=sys.stderr)
                    context.close()
    emit('panel.axe_violations', found, 'violations', 'pages looked at', looked)


FIGURES = {
    'panel.axe_violations': axe_violations,
}
