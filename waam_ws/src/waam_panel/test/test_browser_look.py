"""How every page looks: both themes, three widths, with an alarm and with a cell that has fallen silent."""

from __future__ import annotations

import math

import pytest
from fake_wizard import book_of, question_of
from page_checks import FOCUS, VIOLATIONS
from panel_requests import MACHINE
from test_browser import CHROMIUM, PATIENCE_MS, Screen

pytest.importorskip('playwright', reason='playwright is not installed (pip install playwright)')
pytestmark = pytest.mark.skipif(not CHROMIUM, reason='chromium is not installed (apt-get)')
# contrast depends on the theme and what is cut on the size: each with each would find the same
LOOKS = [((1366, 768), 'dark'), ((1024, 768), 'light'), ((390, 844), 'dark')]
PAGES = ('run', 'setup', 'move', 'alarms', 'jobs', 'machine', 'gcode', 'standoff', 'commission')
DEAD = 'body:not(.lost) #job-tile.stale'


def a_shift(panel) -> None:
    """A job in HOLD after a lost arc: banner, held tile, values of every section."""
    machine = MACHINE | {'homed': True, 'state': 'HOLD', 'fault': 204, 'fault_text': 'arc lost'}
    heat = {'factor': 1.0, 'temperature': 140.0, 'rate': 1.0, 'limit': 150.0, 'ready': False, 'wait': 65.0,
            'plausible': False, 'reasons': []}  # fmt: skip
    held = {'value': 'current', 'unit': 'A', 'set': 120.0, 'measured': 90.0, 'speed': 1.0, 'wire': 1.0, 'limited': True,
            'frozen': '', 'operator_speed': 1.0, 'operator_wire': 1.0}  # fmt: skip
    standoff = {'source': 'laser', 'set_mm': 100.0, 'measured_mm': 99.0, 'correction_mm': 0.5}
    panel.speak(
        ('machine', machine), ('telemetry', panel.still(wire_feed='underfeed')), ('heat', heat),
        ('job', panel.job('PAUSED', id='20261128T204732Z_jaw_of_a_large_clamp', message='no wire: change the spool')),
        ('temperature', {'value': 140.0}), ('process', held),
        ('standoff', standoff | {'alarm': 'frozen'}),
    )  # fmt: skip


def violations(s: Screen, where: str) -> list[str]:
    return [f'{where}: {v}' for v in s.page.evaluate(VIOLATIONS)]


def of_all_pages(s: Screen, what: str) -> list[str]:
    found = []
    for name in PAGES:
        s.page.click(f'nav [data-page={name}]')
        s.visible(f'#{name}.on')
        found += violations(s, f'{what} {name}')
    return found


@pytest.mark.parametrize(('size', 'theme'), LOOKS)
def test_no_page_violates_what_a_program_can_check(panel, browser, made_jobs, size, theme):
    made_jobs(1)
    a_shift(panel)
    s = Screen(browser, *size, color_scheme=theme)
    s.page.goto(panel.url)
    s.shows('#job-state', 'PAUSED')
    s.visible('#banner')
    found = of_all_pages(s, 'held')
    panel.living, panel.saying = (), {}
    s.visible(DEAD)
    found += of_all_pages(s, 'silent')
    panel.server.close()
    s.visible('body.lost #lost')
    s.page.click('nav [data-page=run]')
    found += violations(s, 'lost')
    assert not found, '\n'.join(found)


@pytest.mark.parametrize(('size', 'theme'), LOOKS)
def test_neither_does_a_commissioning_that_asks_or_has_stopped(panel, browser, size, theme):
    run = panel.cell.commissioning
    run.book, run.version, run.running = book_of(panel.folder), 1, True
    run._read = math.inf
    run.lines.append(
        'waam: error: as long as a path: /home/somebody/waam/calibrations/cells/gantry1/commission/x.yaml'
    )
    s = Screen(browser, *size, color_scheme=theme)
    s.page.goto(f'{panel.url}#commission')
    found = []
    for number, step in enumerate(('', 'long', 'file'), 1):
        run.asked = question_of(step) | {'number': number, 'wrong': 'wanted is a number'}
        label = 'Begin with this part' if step == 'file' else 'Enter'
        s.visible(f'#c-answers button:not([disabled]):text-is("{label}")')
        found += violations(s, f'asked {step}')
    run.asked, run.running, run.ended = None, False, 'to mend: it is bridged'
    s.shows('#c-start', 'Go on with settings')
    s.visible('#c-ended.bad')
    for step in ('✓ link', '○ arc'):
        s.page.click(f'summary:has(b:text-is("{step}"))')
    found += violations(s, 'stopped')
    assert not found, '\n'.join(found)


@pytest.mark.parametrize(('size', 'theme'), LOOKS)
def test_neither_do_the_door_and_the_page_of_the_cells(make_panel, browser, size, theme):
    panel = make_panel(tokens=True)
    s = Screen(browser, *size, color_scheme=theme)
    s.page.goto(panel.url)
    s.visible('[name=token]')
    found = violations(s, 'login')
    s.page.fill('[name=token]', panel.tokens['maintain'])
    s.page.keyboard.press('Enter')
    s.visible('#machine-tile')
    s.page.goto(f'{panel.url}/cells')
    s.visible('#log-box')
    s.visible('#cards .card')
    found += violations(s, 'cells')
    s.page.evaluate("document.body.classList.add('lost')")
    found += violations(s, 'cells, lost')
    assert not found, '\n'.join(found)


def test_the_checks_find_what_is_wrong(browser):
    """Each of them, or an empty list would say nothing."""
    s = Screen(browser, 1024, 768)
    s.page.set_content("""<!doctype html><html><head><meta name=viewport content="maximum-scale=1"></head>
      <body style="margin:0">
      <h1>one</h1><h3>three</h3><p id=a style="color:#999">pale</p><p id=a style="opacity:.4">paler</p>
      <div style="background:repeating-linear-gradient(45deg,#000 0 4px,#fff 4px 8px)"><b>striped</b></div>
      <button></button><input><a href="#x" aria-describedby=gone>link</a><img src="data:,">
      <div style="width:2000px">wide</div>
      <div style="width:40px;overflow:hidden;white-space:nowrap">long enough to be cut</div>
      <p style="color:#777;font-size:30px">large may be paler</p><button disabled style="color:#ccc">off</button>
      <i tabindex=3>first</i></body></html>""")
    found = ' | '.join(s.page.evaluate(VIOLATIONS))
    for words in (
        "contrast 2.85: p#a 'pale'", "'paler'", "'striped'", 'no name: button', 'no name: input', 'no alt: img',
        'heading skips a level: h3', 'two of #a', 'no language', 'no title', 'not one main', 'no #gone',
        'zooming is forbidden', 'px wide of 1024', "cut: div 'long enough", 'order of the keyboard is forced',
    ):  # fmt: skip
        assert words in found, (words, found)
    assert 'large may be paler' not in found and "'off'" not in found


def test_the_page_follows_the_system_until_somebody_chooses(panel, browser):
    s = Screen(browser, 1024, 768, color_scheme='dark')
    ground = 'getComputedStyle(document.body).backgroundColor'
    s.page.goto(panel.url)
    s.shows('#theme', 'Light')
    dark = s.page.evaluate(ground)
    s.page.emulate_media(color_scheme='light')
    s.shows('#theme', 'Dark')
    assert s.page.evaluate(ground) == 'rgb(255, 255, 255)' != dark
    s.click('#theme')
    s.page.reload()
    s.shows('#theme', 'Light')
    assert s.page.evaluate(ground) == dark
    s.page.goto(f'{panel.url}/cells')
    assert s.page.evaluate(ground) == dark
    s.page.goto(panel.url)
    s.click('#theme')  # as the system has it: follows it again
    s.page.emulate_media(color_scheme='dark')
    s.shows('#theme', 'Light')


def test_from_the_door_to_a_report_by_keyboard_alone(make_panel, browser, made_jobs):
    made_jobs(1)
    panel = make_panel(tokens=True)
    s = Screen(browser, 1366, 768)
    s.page.goto(panel.url)
    s.visible('[name=token]')
    s.page.keyboard.type(panel.tokens['operate'])  # the field has the focus
    s.page.keyboard.press('Enter')
    s.visible('#machine-tile')

    def to(wanted) -> dict:
        for _ in range(80):
            s.page.keyboard.press('Tab')
            now = s.page.evaluate(FOCUS)
            assert now['tag'] == 'BODY' or (now['ring'] and now['inside']), now
            if wanted(now):
                return now
        raise AssertionError('the keyboard does not get there')

    to(lambda now: now['id'] == 'stop')
    to(lambda now: now['id'].endswith('Jobs'))
    s.page.keyboard.press('Enter')
    s.visible('#job-list a')
    to(lambda now: now['href'].endswith('report.html'))
    with s.context.expect_page(timeout=PATIENCE_MS) as opened:
        s.page.keyboard.press('Enter')
    assert opened.value.url.endswith('report.html')


def test_form_and_page_stay_over_a_reload_and_not_in_another_tab(panel, browser):
    s = Screen(browser, 1366, 768)
    s.page.goto(panel.url)
    s.click('nav [data-page=setup]')
    s.visible('#setup.on')
    s.page.wait_for_selector('#f-material option', state='attached')
    s.page.fill('#f-operator_name', 'Олена')
    s.page.fill('#f-tolerance_mm', '0,35')
    s.page.select_option('#f-mode', 'build')
    s.page.reload()
    s.visible('#setup.on')
    s.has_value('#f-operator_name', 'Олена')
    s.has_value('#f-tolerance_mm', '0,35')
    s.has_value('#f-mode', 'build')
    other = Screen(browser, 1366, 768)
    other.page.goto(panel.url)
    other.has_value('#f-operator_name', '')
    assert s.said == [] and other.said == []


def test_what_is_left_counts_down_and_names_the_end(panel, browser):
    s = Screen(browser, 1366, 768, timezone_id='Europe/Kyiv', locale='uk-UA')
    s.page.goto(panel.url)
    panel.operations.running_job = True
    panel.speak(
        ('machine', MACHINE),
        ('telemetry', panel.still()),
        ('job', panel.job('DEPOSITING', time_left=754.0)),
    )
    s.shows('#job-detail', r'bead 2/9, 30 %, left 12:3\d, done at \d\d:\d\d')
    s.shows('#job-detail', 'left 12:2')  # goes on although the job says the same
    panel.saying['job'] = panel.job('DEPOSITING', time_left=4000.0)
    s.shows('#job-detail', r'left 1:06:\d\d')
    panel.saying['job'] = panel.job('DEPOSITING', time_left=None)
    s.shows('#job-detail', 'time left not known')
    panel.saying['job'] = panel.job('DEPOSITING', time_left=0.0)
    s.shows('#job-detail', 'longer than estimated')


def test_the_wire_on_the_spool_stands_beside_what_the_job_needs(panel, browser, monkeypatch):
    from waam_panel import api

    told = {'layer': 1, 'left_m': 40.0, 'need_m': 12.34, 'words': 'it fits'}
    monkeypatch.setattr(api, 'spool_of', lambda folder, number: told)
    s = Screen(browser, 1366, 768)
    s.page.goto(panel.url)
    panel.operations.running_job = True
    panel.speak(
        ('machine', MACHINE),
        ('telemetry', panel.still()),
        ('job', panel.job('DEPOSITING', dir='somewhere')),
    )
    s.visible('#spool-value')
    s.shows('#spool-value', r'40\.0m, needs 12\.3 m: it fits')
    told |= {'left_m': 10.0, 'words': 'it is too little'}
    s.visible('#spool-value.bad')
