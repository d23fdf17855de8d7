"""What is typed: numbers in three locales, keys of three layouts. A real browser on a panel without ROS."""

from __future__ import annotations

import json

import pytest
from panel_requests import MACHINE
from test_browser import CHROMIUM, Screen
from test_panel_numbers import READ, REFUSED

from waam_panel import numbers

pytest.importorskip('playwright', reason='playwright is not installed (pip install playwright)')
pytestmark = pytest.mark.skipif(not CHROMIUM, reason='chromium is not installed (apt-get)')
LOCALES = ('en-US', 'de-DE', 'uk-UA')
TYPED = (  # text in the field, what the machine may get: None = nothing is sent
    ('0,2', 0.2), ('0.2', 0.2), (' 0,25 mm', 0.25), ('2', 2.0), ('1.234,5', None), ('1,234.5', None), ('1 000', None),
    ('1e', None), ('1e-1', None), ('0x1', None), ('NaN', None), ('\uff11', None), ('\u0661', None), ('0,2 in', None),
    ('-', None), ('99', None), ('0', None), ('0,,2', None),
)  # fmt: skip
READ_ALL = """async (cases) => {
  const { readNumber } = await import('/static/numbers.js');
  return cases.map(([text, low, high, unit, whole]) => readNumber(text, low, high, unit, whole));
}"""


@pytest.fixture
def loaded(panel):
    """A panel with a part and with programs that stay alive."""
    (panel.folder / 'parts').mkdir()
    (panel.folder / 'parts' / 'block.stl').write_bytes(b'solid')
    (panel.folder / 'parts' / 'p.gcode').write_text('G1 X1')
    panel.speak(('machine', MACHINE))
    return panel


def sent(s: Screen, act) -> list[tuple[str, dict]]:
    """Requests that change something while `act` runs, and a moment after."""
    found: list[tuple[str, dict]] = []
    listen = lambda r: r.method == 'POST' and found.append((r.url, json.loads(r.post_data or '{}')))  # noqa: E731
    s.page.on('request', listen)
    act()
    s.page.evaluate('new Promise((done) => setTimeout(done, 50))')
    s.page.remove_listener('request', listen)
    return [(url.rpartition('/api/')[2], data) for url, data in found]


@pytest.mark.parametrize('locale', LOCALES)
def test_a_number_is_what_was_typed_or_nothing_is_sent(loaded, browser, locale):
    s = Screen(browser, 1280, 800, locale=locale)
    s.page.goto(loaded.url)
    s.click('nav [data-page=setup]')
    s.visible('#f-tolerance_mm[data-high]')
    s.page.wait_for_selector('#load:enabled')
    for text, value in TYPED:
        s.page.fill('#f-tolerance_mm', text)
        requests = sent(s, lambda: s.click('#load'))
        assert [d['tolerance_mm'] for n, d in requests if n == 'load'] == (
            [value] if value else []
        ), text
        if value is None:
            assert s.page.text_content('#toast').startswith('Tolerance: '), text
            assert s.page.get_attribute('#f-tolerance_mm', 'aria-invalid') == 'true'
        else:
            s.shows('#said-text', f'tolerance {value:g} mm;')
    s.page.fill('#f-tolerance_mm', '')  # not given: the default that stands there in grey
    assert s.page.get_attribute('#f-tolerance_mm', 'placeholder') == '0.2'
    ((_, data),) = sent(s, lambda: s.click('#load'))
    assert all(
        data[n] is None
        for n in (
            'tolerance_mm',
            'layers',
            'layer_height_mm',
            'bead_width_mm',
            'passes',
            'allowance_mm',
        )
    )
    s.shows('#said-text', 'tolerance 0.2 mm; all layers; layer height as the material says')
    assert s.said == []


def test_every_number_field_says_what_is_wrong_and_has_no_trap_of_a_locale(loaded, browser):
    s = Screen(browser, 1280, 800, locale='de-DE')
    s.page.goto(loaded.url)
    assert s.page.locator('input[type=number]').count() == 0
    ids = s.page.eval_on_selector_all('input[data-number]', 'all => all.map((e) => e.id)')
    assert len(ids) >= 13
    pages = {'f': 'setup', 'g': 'gcode', 's': 'standoff'}
    buttons = {'f': '#load', 'g': '#g-load', 's': '#s-apply'}
    for name in ids:
        kind = name[0]
        s.click(f'nav [data-page={pages[kind]}]')
        s.page.wait_for_selector(f'#{name}[data-high]', state='attached')
        if kind == 's':
            s.has_value('#s-source', 'laser')
            s.page.select_option('#s-source', 'arc')
        s.page.wait_for_selector(f'{buttons[kind]}:enabled')
        before = s.page.input_value(f'#{name}')
        for wrong in ('1.234,5', '1e', '1 0', '\u0661'):
            s.page.fill(f'#{name}', wrong)
            assert sent(s, lambda k=kind: s.click(buttons[k])) == [], name
            assert (
                'not understood' in (told := s.page.text_content('#toast'))
                or 'mark' in told
                or 'gap' in told
            )
        s.page.fill(f'#{name}', before)
    s.page.fill('#s-up_mm', '')  # has no default
    assert sent(s, lambda: s.click('#s-apply')) == []
    s.shows('#toast', 'Up at most: empty')
    s.click('nav [data-page=gcode]')
    s.page.fill('#g-x', '-0,5')
    ((name, data),) = [r for r in sent(s, lambda: s.click('#g-load')) if r[0] == 'program/load']
    assert data['shift_mm'] == [-0.5, None, None]
    assert s.said == [] or all('status of 4' in text for text in s.said)


def test_the_browser_reads_numbers_as_the_server_does(panel, browser):
    texts = [
        *READ,
        *REFUSED,
        '1,000',
        '1.000',
        '0,125',
        '12,345',
        '-1.000',
        '2.5',
        '1000',
        '5 mm',
        '-0',
    ]
    cases = [
        (t, *limits, unit, whole) for t in texts for limits in ((-1000, 1000), (0.02, 5), (0, 1000))
        for unit in ('mm', '') for whole in (False, True)
    ]  # fmt: skip
    s = Screen(browser, 800, 600)
    s.page.goto(panel.url)
    for case, found in zip(cases, s.page.evaluate(READ_ALL, cases), strict=True):
        try:
            expected = {'value': numbers.read(*case)}
        except numbers.NumberRefused:
            assert found.get('problem'), case
        else:
            assert found == expected, case


# ---- keys


FIELDS = (
    '#f-name',
    '#f-tolerance_mm',
    '#f-material',
    '#f-mode',
    '#a-part',
    '#g-x',
    '#s-up_mm',
    '#g-layer',
)
ACTS = {'pause', 'stop', 'arm', 'start', 'resume', 'home', 'jog', 'acknowledge'}
KEYS = (
    'Escape',
    'p',
    'a',
    'Shift+S',
    'S',
    's',
    'r',
    'h',
    'k',
    't',
    '1',
    '8',
    'ArrowLeft',
    'PageUp',
    'Enter',
)


def test_nothing_that_is_typed_into_a_field_reaches_the_machine(loaded, browser):
    s = Screen(browser, 1280, 800)
    loaded.speak(
        ('machine', MACHINE | {'armed': True, 'homed': True}), ('job', loaded.job('DEPOSITING'))
    )
    s.page.goto(loaded.url)
    s.shows('#job-state', 'DEPOSITING')
    pages = {'f': 'setup', 'a': 'jobs', 'g': 'gcode', 's': 'standoff'}
    s.page.evaluate("""() => { const d = document.createElement('div'); d.id = 'x-edit'; d.contentEditable = 'true';
      d.textContent = 'text'; document.getElementById('setup').append(d);
      document.getElementById('g-layer').disabled = false; document.getElementById('archive-box').hidden = false; }""")
    for field in (*FIELDS, '#x-edit'):
        s.click(f'nav [data-page={pages.get(field[1], "setup")}]')
        requests = sent(
            s, lambda f=field: [(s.page.focus(f), s.page.keyboard.press(k)) for k in KEYS]
        )
        assert not ACTS & {n for n, _ in requests}, field
        if field not in ('#f-material', '#f-mode'):  # whose list Esc closes first
            s.page.focus(field)
            s.page.keyboard.press('Escape')
            left = s.page.evaluate('document.activeElement === document.body')
            assert left, field
    assert [n for n, _ in sent(s, lambda: s.page.keyboard.press('Escape'))] == ['pause']


PRESS = """([key, code, more]) => document.body.dispatchEvent(
  new KeyboardEvent('keydown', { key, code, bubbles: true, cancelable: true, ...more }))"""
LAYOUTS = (  # key, code, modifiers, what is asked for
    ('a', 'KeyA', {}, ['arm']), ('ф', 'KeyA', {}, ['arm']), ('A', 'KeyA', {}, ['arm']),  # Caps Lock
    ('a', 'KeyQ', {}, ['arm']), ('q', 'KeyA', {}, []),  # French: as it is printed
    ('з', 'KeyP', {}, ['pause']), ('p', 'KeyP', {}, ['pause']), ('p', 'KeyP', {'repeat': True}, []),
    ('a', 'KeyA', {'repeat': True}, []), ('a', 'KeyA', {'ctrlKey': True}, []), ('a', 'KeyA', {'metaKey': True}, []),
    ('a', 'KeyA', {'altKey': True}, []), ('a', 'KeyA', {'isComposing': True}, []),
    ('Process', 'KeyA', {'keyCode': 229}, []),
    ('Escape', 'Escape', {'repeat': True}, []), ('Escape', 'Escape', {'altKey': True}, []),
)  # fmt: skip
STARTS = (
    ('S', 'KeyS', {'shiftKey': True}, ['start']), ('s', 'KeyS', {'shiftKey': True}, ['start']),  # with Caps Lock
    ('І', 'KeyS', {'shiftKey': True}, ['start']), ('S', 'KeyS', {}, []), ('s', 'KeyS', {}, []), ('і', 'KeyS', {}, []),
    ('S', 'KeyS', {'shiftKey': True, 'repeat': True}, []), ('S', 'KeyS', {'shiftKey': True, 'ctrlKey': True}, []),
)  # fmt: skip


def test_keys_mean_the_same_on_every_layout_and_nothing_starts_by_accident(loaded, browser):
    s = Screen(browser, 1280, 800)
    loaded.speak(('machine', MACHINE), ('telemetry', loaded.still()), ('job', loaded.job('IDLE')))
    s.page.goto(loaded.url)
    s.click('nav [data-page=setup]')
    s.page.select_option('#f-mode', 'build')
    s.page.wait_for_selector('#load:enabled')
    s.click('#load')
    s.page.wait_for_selector('#arm:enabled')
    s.page.evaluate('document.activeElement.blur()')

    def asked(case) -> list[str]:
        return [n for n, _ in sent(s, lambda: s.page.evaluate(PRESS, case[:3]))]

    for case in LAYOUTS:
        if 'pause' in case[3]:
            continue
        assert asked(case) == case[3], case
    loaded.speak(
        ('machine', MACHINE | {'armed': True}),
        ('telemetry', loaded.still()),
        ('job', loaded.job('IDLE')),
    )
    s.page.wait_for_selector('#start:enabled')
    for case in STARTS:
        assert asked(case) == case[3], case
    s.page.evaluate(
        """() => { const d = document.createElement('dialog'); document.body.append(d); d.showModal(); }"""
    )
    assert asked(STARTS[0]) == []
    s.page.evaluate("document.querySelector('dialog').remove()")
    loaded.speak(('machine', MACHINE | {'armed': True}), ('job', loaded.job('DEPOSITING')))
    s.shows('#job-state', 'DEPOSITING')
    for case in LAYOUTS:
        if case[1] in ('KeyP', 'Escape'):
            assert asked(case) == case[3], case


def test_a_held_jog_ends_with_the_finger_the_window_and_the_connection(loaded, browser):
    s = Screen(browser, 1280, 800)
    loaded.speak(
        ('machine', MACHINE | {'homed': True}),
        ('telemetry', loaded.still()),
        ('job', loaded.job('IDLE')),
    )
    s.page.goto(loaded.url)
    s.click('nav [data-page=move]')
    s.page.wait_for_selector('[data-jog="x+"]:enabled')
    box = s.page.locator('[data-jog="x+"]').bounding_box()

    def hold() -> None:
        s.page.mouse.move(box['x'] + 20, box['y'] + 20)
        s.page.mouse.down()
        with s.page.expect_request('**/api/jog'):
            pass
        with s.page.expect_response('**/api/jog'):
            pass

    ways = (
        'dispatchEvent(new Event("blur"))',
        'Object.defineProperty(document, "hidden", { value: true, configurable: true });'
        'document.dispatchEvent(new Event("visibilitychange")); delete document.hidden',
        'document.querySelector(\'[data-jog="x+"]\').dispatchEvent(new Event("lostpointercapture"))',
        'dispatchEvent(new Event("pagehide"))',
    )
    for way in ways:
        hold()
        s.page.evaluate(way)
        s.page.evaluate('new Promise((done) => setTimeout(done, 400))')  # what is on its way
        later = sent(s, lambda: s.page.evaluate('new Promise((done) => setTimeout(done, 600))'))
        assert later == [], way
        s.page.mouse.up()
