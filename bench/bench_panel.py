"""The operator's page in a real browser: what it shows that is not known, and what it takes that was not meant.

panel.stale_shown: fields that look present 3 s after their source died: every program of a graph is killed and
suspended in turn while the arc burns (baseline: fields that were looked at). panel.numbers_wrong: of 200 texts typed
into number fields, in each of three locales, those that reached the job as another number, or were taken though they
are no number (baseline: texts typed). panel.axe_violations: of WCAG 2.2 AA and of what must not be cut, on every page
of a panel without a cell, in both themes and at three widths (baseline: pages looked at); axe-core is no dependency,
the checks are those of waam_panel/test/page_checks.js.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from lib.emit import emit
from lib.job_part import write_part
from lib.live_graph import LiveGraph
from lib.node import NodeUnderTest

DEAD_S = 3.0
PATIENCE_MS = 60_000
NODES = (
    'job_sequencer', 'bridge', 'scan_fusion', 'correction_server', 'feed_forward', 'thermal_compensator',
    'process_control', 'recorder', 'dashboard', 'cell', 'virtual_controller',
)  # fmt: skip
LOCALES = ('en-US', 'de-DE', 'uk-UA')
TEXTS = 200
# of elements that show something of a section: text, whether it is marked, sections
FIELDS = """() => [...document.querySelectorAll('[data-from]')].filter((e) => !e.closest('[hidden]')).map((e) => {
  const off = (x) => x.closest('#standoff') && document.getElementById('standoff-facts').textContent.includes('off');
  const mine = (x) => x.closest('[data-from]') === e && !off(x);
  const said = [e, ...e.querySelectorAll('*')].filter((x) => x.matches('b, s, td, span, canvas') && mine(x));
  const texts = said.map((x) => (x.tagName === 'CANVAS' ? 'drawn' : x.textContent.trim()));
  const words = texts.filter((x) => x && x !== '–');
  return [e.dataset.from.split(' '), words, Boolean(e.closest('.stale'))];
})"""
UNKNOWN = (
    'not known',
    'does not answer',
    'nothing on',
    'NOT CONNECTED',
    'no part loaded',
    'loaded: ',
)


@contextmanager
def browser():
    """A Chromium."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        path = shutil.which('chromium') or shutil.which('google-chrome')
        made = p.chromium.launch(executable_path=path, args=['--no-sandbox'])
        yield made
        made.close()


def shows(page, selector: str, pattern: str, patience_ms: int = PATIENCE_MS) -> None:
    import re

    from playwright.sync_api import expect

    expect(page.locator(selector)).to_have_text(re.compile(pattern), timeout=patience_ms)


# ---- panel.stale_shown


def sections_of(node: str) -> set[str]:
    """Sections of the page that a program is the source of; the controller's come through the bridge."""
    from waam_panel.sources import SOURCES

    if node == 'virtual_controller':
        return {'telemetry'}
    return {name for name, source in SOURCES.items() if source.node == node}


def looked_at(page, sections: set[str]) -> tuple[list[str], list[str]]:
    """Fields of these sections that show something, and those of them that look present."""
    fields, present = [], []
    for names, words, stale in page.evaluate(FIELDS):
        if not sections & set(names):
            continue
        known = [w for w in words if not any(u in w for u in UNKNOWN)]
        fields += [f'{names}: {w}' for w in words]
        present += [] if stale else [f'{names}: {w}' for w in known]
    return fields, present


def begin(page) -> None:
    """The arc burns, or at least the machine stands and all programs answer."""
    from playwright.sync_api import Error

    page.wait_for_selector('body:not(.lost)')
    try:
        page.click('#stop')
        shows(page, '#machine-state', 'IDLE|ALARM')
        page.click('nav [data-page=move]')
        if page.text_content('#machine-state') == 'ALARM':
            page.click('#reset')
            shows(page, '#machine-state', 'IDLE')
        if page.is_enabled('#disarm'):  # by a job whose program was killed
            page.click('#disarm')
        page.click('nav [data-page=setup]')
        page.select_option('#f-part', 'block.stl')
        page.select_option('#f-as_found', 'block_worn.stl')
        page.click('#load')
        shows(page, '#said-text', 'Loaded: ')
        page.click('#arm')
        page.click('#start')
        shows(page, '#arc-state', 'ON', 20_000)
    except (Error, AssertionError) as e:
        print('without an arc:', *str(e).splitlines()[:5], file=sys.stderr)
    page.click('nav [data-page=machine]')
    page.evaluate('new Promise((done) => setTimeout(done, 1000))')


def one_death(page, graph: LiveGraph, node: str, kill: bool) -> tuple[int, int]:
    """Fields that were looked at, and those that look present DEAD_S after the death."""
    begin(page)
    sections = sections_of(node)
    before, _ = looked_at(page, sections)
    pid = graph.pid(node)
    if kill:
        graph.kill(node)
    else:
        os.kill(pid, signal.SIGSTOP)
    died = time.monotonic()
    page.evaluate(f'new Promise((done) => setTimeout(done, {1000 * DEAD_S}))')
    _, present = looked_at(page, sections)
    present = [x for x in present if 'drawn' not in x or x in before]  # what was off is no field
    gone = page.text_content('#programs')
    if node != 'virtual_controller' and f'{node}! gone' not in gone:
        before, present = before + 1, present + 1
    late = round(time.monotonic() - died, 2)
    way = 'killed' if kill else 'suspended'
    print(json.dumps([node, way, len(before), present, late]), file=sys.stderr)
    if kill:
        graph.revive(node)
    else:
        os.kill(pid, signal.SIGCONT)
    return len(before) + 1, len(present)


def stale_shown() -> None:
    from waam_bringup.client import GraphClient
    from waam_bringup.graph import Settings
    from waam_bringup.operate import free_port
    from waam_node.testing import fresh_domain

    looked = present = 0
    with tempfile.TemporaryDirectory() as folder, browser() as chromium:
        root = Path(folder)
        parts = root / 'jobs' / 'parts'
        parts.mkdir(parents=True)
        for made, name in zip(write_part(root), ('block', 'block_worn'), strict=True):
            made.rename(parts / f'{name}.stl')
        os.environ['WAAM_JOBS'] = str(root / 'jobs')
        for kill in (True, False):
            port, domain = free_port(), fresh_domain()
            settings = Settings(run=root / f'run{kill}', rate=1.0, panel_port=port)
            graph = LiveGraph(settings, domain, 90.0)
            graph.start()
            try:
                with GraphClient(domain) as client:
                    graph.ready(client)
                    page = chromium.new_page(viewport={'width': 1280, 'height': 800})
                    page.set_default_timeout(PATIENCE_MS)
                    page.goto(f'http://127.0.0.1:{port}/')
                    for node in NODES:
                        graph.ready(client)
                        a, b = one_death(page, graph, node, kill)
                        looked, present = looked + a, present + b
                    page.close()
            finally:
                graph.stop()
    emit('panel.stale_shown', present, 'fields', 'fields looked at', looked)


# ---- panel.numbers_wrong


def texts(count: int) -> list[tuple[str, float | None]]:
    """Texts for a length of 0.02 to 5 mm, and what they mean: None = no number, or none within the limits."""
    rng = np.random.default_rng(41)
    found: list[tuple[str, float | None]] = []
    wrong = (
        '1.234,5', '1,234.5', '1 000', '1e', '1e-1', 'NaN', '0x1', '\uff11', '\u0661', '0,2 in', '0.2.1', '-', ',',
        '1-', '', '9' * 50,
    )  # fmt: skip
    for n in range(count):
        if n % 5 == 4:
            text = wrong[(n // 5) % len(wrong)]
            found.append((text, None))
            continue
        value = round(float(rng.uniform(0.02, 5.0)), int(rng.integers(1, 4)))
        value = max(value, 0.02) * (10.0 if n % 10 == 7 else 1.0)
        text = f'{value:.4f}'.rstrip('0').rstrip('.')
        text = text.replace('.', ',') if n % 2 else text
        text = ('', ' ', '\u00a0')[n % 3] + text + ('', ' mm', 'mm', ' ')[n % 4]
        meant = float(text.strip(' m\u00a0').replace(',', '.'))
        found.append((text, meant if 0.02 <= value <= 5.0 else None))
    return found


def numbers_wrong() -> None:
    from waam_bringup.operate import free_port

    wrong = typed = 0
    with tempfile.TemporaryDirectory() as folder, browser() as chromium:
        root, port = Path(folder), free_port()
        (root / 'parts').mkdir()
        (root / 'parts' / 'a.stl').write_bytes(b'solid')
        given = (f'port:={port}', f'jobs_dir:={root}', f'part_folders:=[{root}/parts]')
        with NodeUnderTest('waam_panel.panel_node', *given):
            for locale in LOCALES:
                context = chromium.new_context(locale=locale)
                page = open_page(context, f'http://127.0.0.1:{port}/')
                for text, meant in texts(TEXTS):
                    typed += 1
                    for fault in faults(type_into(page, text), text, meant):
                        wrong += 1
                        print(f'{locale}: {text!r} {fault}', file=sys.stderr)
                context.close()
    emit('panel.numbers_wrong', wrong, 'texts', 'texts typed', typed)


def faults(taken: list[dict], text: str, meant: float | None) -> Iterator[str]:
    """What is wrong with what was posted for a text. An empty one stands for the default, which is in the field."""
    from waam_panel.setup_form import FormError, parse

    for data in taken:
        try:
            got = parse(data, (data['material'],)).tolerance_mm
        except FormError:
            got = None
        if got != (meant if text.strip() else 0.2):
            yield f'became {got}'
    if not taken and (meant is not None or not text.strip()):
        yield 'was not taken'


def open_page(context, url: str):
    """The page *Set up* of a panel that is just starting; what it would load is kept, and refused."""
    from playwright.sync_api import Error

    page, end = context.new_page(), time.monotonic() + 60
    page.set_default_timeout(PATIENCE_MS)
    page.loaded = []

    def keep(route) -> None:
        page.loaded.append(json.loads(route.request.post_data))
        route.fulfill(json={'ok': False, 'message': 'kept'})

    page.route('**/api/load', keep)
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


def type_into(page, text: str) -> list[dict]:
    """What is posted when this stands in the field of the tolerance and Load is pressed."""
    page.loaded.clear()
    page.evaluate("document.getElementById('toast').textContent = ''")
    page.fill('#f-tolerance_mm', text)
    page.click('#load')
    shows(page, '#toast', '.')
    return list(page.loaded)


# ---- panel.axe_violations

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
    'panel.stale_shown': stale_shown,
    'panel.numbers_wrong': numbers_wrong,
    'panel.axe_violations': axe_violations,
}
