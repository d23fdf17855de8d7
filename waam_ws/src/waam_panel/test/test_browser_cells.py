"""The page of all cells in a real browser: two cells, queue, release, roles, lost connection. No ROS.

WAAM_SCREENSHOTS=docs/panel keeps a picture there.
"""

from __future__ import annotations

import os
import re
import shutil
import time

import pytest
from panel_requests import MACHINE, until

CHROMIUM = shutil.which('chromium') or shutil.which('google-chrome')
pytest.importorskip('playwright', reason='playwright is not installed (pip install playwright)')
pytestmark = pytest.mark.skipif(not CHROMIUM, reason='chromium is not installed (apt-get)')
PICTURES = os.environ.get('WAAM_SCREENSHOTS', '')


def shows(page, selector: str, pattern: str) -> None:
    from playwright.sync_api import expect

    expect(page.locator(selector).first).to_contain_text(re.compile(pattern), timeout=20_000)


def open_page(browser, panel, role: str = ''):
    """The page of cells, and what its console says."""
    page, said = browser.new_page(viewport={'width': 1280, 'height': 800}), []
    page.on('pageerror', lambda e: said.append(str(e)))
    page.on('dialog', lambda d: d.accept())
    page.goto(panel.url)
    if role:
        page.fill('[name=token]', panel.tokens[role])
        page.click('button')
        page.wait_for_url(f'{panel.url}/')
    page.goto(f'{panel.url}/cells')
    return page, said


def picture(page, name: str) -> None:
    if PICTURES:
        page.screenshot(path=f'{PICTURES}/{name}.png')


def tell(panel, **job) -> None:
    """From now on, again and again."""
    panel.speak(('machine', MACHINE), ('job', panel.job(job.pop('state', 'IDLE'), **job)))


def shows_when_told(panel, page, selector: str, pattern: str) -> None:
    """The machine is told of all the while: old news start nothing, and this computer may be busy."""
    end = time.monotonic() + 60
    while not re.search(pattern, page.locator(selector).first.inner_text()):
        assert time.monotonic() < end, page.locator(selector).first.inner_text()
        tell(panel)
        page.wait_for_timeout(200)


def test_an_operator_sees_all_cells_and_steers_the_queue_of_one(make_panel, browser, write_part):
    here, there = make_panel(tokens=True), make_panel(tokens=True, name='cell2')
    write_part(here.folder / 'parts')
    setup = {'part': 'block.stl', 'as_found': 'block_worn.stl', 'material': 'er70s-6'}
    for _ in range(3):
        here.cell.shop.queue.change(lambda q: q.add(setup, '<b>Ada</b>', time.time()))
    tell(here)
    depositing = {'layer': 2, 'layers': 5, 'progress': 0.3, 'time_left': 480.0}
    tell(there, id='20260101T000000Z_anvil', state='DEPOSITING', **depositing)
    there.cell.mailbox.put(('anomaly', {'class': 'wire', 'severity': 2, 'text': 'slips'}))
    page, said = open_page(browser, here, 'operate')
    shows(page, '#me', '^operate 0: operate$')
    shows(page, '.card:nth-child(1)', 'cell.*up.*queue: 3 waiting')
    shows(page, '.card:nth-child(2)', 'DEPOSITING 2/5, 30 %, left 8 min.*! Wire')
    assert 'bad' in page.get_attribute('.card:nth-child(2)', 'class')
    shows(page, '#queue tr:nth-child(1) td:nth-child(4)', '^<b>Ada</b>$')  # text, not markup
    picture(page, 'cells')
    page.click('#queue tr:nth-child(3) button:text("Up")')
    shows(page, '#queue tr:nth-child(2) td:nth-child(1)', '^3$')
    page.click('#queue tr:nth-child(1) button:text("Remove")')
    shows(page, '#queue tr:nth-child(1) td:nth-child(1)', '^3$')
    page.click('#queue tr:nth-child(1) button:text("Release")')
    shows_when_told(here, page, '#queue tr:nth-child(1)', 'running[^$]*released by operate 0')
    picture(page, 'cells_released')
    until(lambda: len(here.operations.asked) > 1, 'looked at, loaded, started')
    assert [a[0] for a in here.operations.asked] == ['load', 'start']
    assert page.locator('#log-box').is_hidden() and said == []
    there.server.close()
    shows(page, '.card:nth-child(2)', 'down')
    here.server.close()
    page.wait_for_selector('#gone', state='visible')
    picture(page, 'cells_lost')


def test_who_may_only_look_has_dead_keys_and_who_maintains_sees_the_log(make_panel, browser):
    panel = make_panel(tokens=True)
    panel.cell.shop.queue.change(lambda q: q.add({'part': 'block.stl'}, 'Ada', 1.0))
    page, _ = open_page(browser, panel, 'view')
    shows(page, '#me', 'view$')
    shows(page, '#queue tr', 'block.stl')
    assert page.locator('#queue button:enabled').count() == 0
    picture(page, 'cells_view')
    page.click('#stop')  # whoever sees the page may stop
    shows(page, '#toast', 'stopped')
    assert panel.operations.asked == [('stop',)]
    page.evaluate("""() => fetch('/api/queue_release', {method: 'POST', body: '{"id": 1}', headers: {
        'Content-Type': 'application/json', 'X-Waam-Csrf': document.querySelector('meta[name=csrf]').content}})""")
    assert panel.cell.shop.queue.read().item(1).state == 'waiting'
    page.context.clear_cookies()
    page, said = open_page(browser, panel, 'maintain')
    shows(page, '#log-verdict', r'^\d+ entries, unbroken$')
    shows(page, '#log', 'queue_release.*denied|denied')
    picture(page, 'cells_log')
    assert said == []


WALL = """W4646
S22
F600
G0 X0 Y0 Z12
; layer 1
G1 Z0
M3
G1 X40
M5
G0 Z12
"""


def test_a_program_goes_into_the_queue_by_its_button_and_is_looked_at_when_it_is_released(
    make_panel, browser
):
    panel = make_panel()
    (panel.folder / 'parts').mkdir()
    (panel.folder / 'parts/wall.gcode').write_text(WALL)
    tell(panel)
    page, said = open_page(browser, panel)
    page.goto(panel.url)
    page.keyboard.press('7')
    page.wait_for_selector('#g-program option[value="wall.gcode"]', state='attached')
    page.fill('#g-x', '5')
    page.select_option('#g-dialect', 'slicer')  # the wrong one
    page.click('#g-enqueue')
    shows(page, '#g-note', ' 1 waits$')
    page.select_option('#g-dialect', 'waam')
    page.click('#g-enqueue')
    shows(page, '#g-note', ' 2 waits$')
    page.goto(f'{panel.url}/cells')
    shows(page, '#queue tr:nth-child(1)', 'wall.gcode.*waiting')
    assert panel.operations.asked == []  # nothing starts by itself
    page.click('#queue tr:nth-child(1) button:text("Release")')
    shows_when_told(panel, page, '#queue tr:nth-child(1)', 'waiting[^$]*line 1: W4646')
    assert panel.operations.asked == []
    page.click('#queue tr:nth-child(2) button:text("Release")')
    until(lambda: len(panel.operations.asked) > 1, 'looked at first, then started')
    assert [a[0] for a in panel.operations.asked] == ['load', 'start_program']
    _, choice, program, _, _ = panel.operations.asked[-1]
    assert choice.shift_mm == (5.0, 0.0, 0.0) and program.name == 'wall.gcode'
    assert said == []
