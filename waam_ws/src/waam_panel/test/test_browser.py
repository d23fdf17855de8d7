"""A whole shift in a real browser on a real graph: what an operator does, clicked and typed.

WAAM_SCREENSHOTS=docs/panel keeps pictures of the pages there.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
from pathlib import Path

import pytest
from panel_requests import MACHINE

from waam_bringup.graph import Settings
from waam_bringup.operate import graph
from waam_msgs.srv import InjectFault
from waam_panel.state import Sample

CHROMIUM = shutil.which('chromium') or shutil.which('google-chrome')
pytest.importorskip('playwright', reason='playwright is not installed (pip install playwright)')
pytestmark = pytest.mark.skipif(not CHROMIUM, reason='chromium is not installed (apt-get)')
PATIENCE_MS = 300_000  # a machine that does other work, too
PICTURES = os.environ.get('WAAM_SCREENSHOTS', '')
RATE = 3.0  # simulated seconds per second: a bead lasts long enough to be seen


class Screen:
    """A page with short ways to do and to wait; keeps everything that the console says."""

    def __init__(self, browser, width: int, height: int, **options) -> None:
        self.context = browser.new_context(viewport={'width': width, 'height': height}, **options)
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE_MS)
        self.said: list[str] = []
        self.page.on('console', self._on_console)
        self.page.on('requestfinished', self._on_finished)
        self.page.on('pageerror', lambda e: self.said.append(f'pageerror: {e}'))

    def _on_console(self, message) -> None:
        if message.type in ('error', 'warning'):
            self.said.append(f'{message.type}: {message.text}')

    def _on_finished(self, request) -> None:
        """What a refused request was and what it was told: the console gives only its number."""
        answer = request.response()
        if answer is not None and answer.status >= 400:
            asked = (request.post_data or '')[:200]
            self.said.append(f'{answer.status} {request.url} {asked}: {answer.text()[:200]}')

    def shows(self, selector: str, pattern: str) -> None:
        from playwright.sync_api import expect

        found = self.page.locator(selector)
        expect(found).to_have_text(re.compile(pattern), timeout=PATIENCE_MS)

    def has_value(self, selector: str, value: str) -> None:
        from playwright.sync_api import expect

        expect(self.page.locator(selector)).to_have_value(value, timeout=PATIENCE_MS)

    def visible(self, selector: str, visible: bool = True) -> None:
        state = 'visible' if visible else 'hidden'
        self.page.locator(selector).first.wait_for(state=state, timeout=PATIENCE_MS)

    def none(self, selector: str) -> None:
        from playwright.sync_api import expect

        expect(self.page.locator(selector)).to_have_count(0, timeout=PATIENCE_MS)

    def click(self, selector: str) -> None:
        self.page.click(selector)  # waits until it is enabled and nothing lies over it

    def picture(self, name: str) -> None:
        if PICTURES:
            Path(PICTURES).mkdir(parents=True, exist_ok=True)
            self.page.screenshot(path=f'{PICTURES}/{name}.png')


@pytest.fixture(scope='module')
def cell(tmp_path_factory, write_part, domain):
    """(address of the page, client of the graph, a part that is not yet uploaded, state of the graph)."""
    folder = tmp_path_factory.mktemp('shift')
    part, worn = write_part(folder / 'usb_stick')
    (folder / 'jobs' / 'parts').mkdir(parents=True)
    shutil.copy(worn, folder / 'jobs' / 'parts')
    before = os.environ.get('WAAM_JOBS')
    os.environ['WAAM_JOBS'] = str(folder / 'jobs')
    try:
        with graph(Settings(run=folder / 'run', seed=3, rate=RATE), domain, timeout=90.0) as (
            state,
            client,
        ):
            yield state.panel_url, client, part, state
    finally:
        os.environ.pop('WAAM_JOBS') if before is None else os.environ.update(WAAM_JOBS=before)


def start(s: Screen) -> None:
    """Arm and Start; the job is under way. The page may still show how the job before has ended."""
    s.click('#arm')
    s.shows('#machine-detail', 'ARMED')
    s.click('#start')
    s.click('nav [data-page=run]')
    s.shows('#job-state', 'VALIDATING|PREPARING|SCANNING|CORRECTING|DEPOSITING')


def gets_to(s: Screen, state: str) -> None:
    """Waits for a state of the job; one that fails before is no job that this test is content with."""
    s.shows('#job-state', f'{state}|FAILED')
    told = s.page.text_content('#job-detail')
    assert 'FAILED' not in s.page.text_content('#job-state'), told


def pictures_of_a_bead(s: Screen) -> None:
    s.click('[data-map=error]')
    s.shows('#arc-state', 'ON')
    s.shows('#map-places', 'mm at x')
    s.picture('run')
    s.page.set_viewport_size({'width': 1024, 'height': 768})
    s.picture('run_tablet')
    s.page.keyboard.press('t')
    s.click('[data-map=path]')
    s.picture('run_dark')
    s.page.keyboard.press('t')
    s.page.set_viewport_size({'width': 390, 'height': 844})
    s.click('[data-map=error]')
    s.page.evaluate('scrollTo(0, 0)')
    s.picture('run_phone')
    s.page.set_viewport_size({'width': 1280, 'height': 800})


def test_a_whole_shift(cell, browser):
    address, client, part, _ = cell
    s = Screen(browser, 1280, 800)
    s.page.goto(address)

    # connect, identify; a cell that a failed try has used already stands still
    s.shows('#machine-state', 'ALARM|IDLE')
    switched_on = s.page.text_content('#machine-state') == 'ALARM'
    s.click('nav [data-page=machine]')
    s.shows('#facts', r'connected[\s\S]*WAAM_CONTROLLER_V1')

    # acknowledge, home, jog by click and key, set zero
    s.click('nav [data-page=move]')
    if switched_on:
        s.click('#reset')
    s.shows('#machine-state', 'IDLE')
    s.click('#home')
    s.shows('#machine-detail', '^homed')
    s.click('#zero')
    s.shows('#p-x', r'^0\.00$')
    s.click('#steps [data-step="10"]')
    s.click('[data-jog="x+"]')
    s.shows('#p-x', r'^10\.00$')
    s.page.keyboard.press('ArrowLeft')
    s.shows('#p-x', r'^0\.00$')
    s.click('[data-jog="y+"]')
    s.shows('#p-y', r'^10\.00$')
    s.click('#zero')
    s.shows('#p-y', r'^0\.00$')
    s.picture('move')

    # load: nothing can be started before; upload, load, preview
    assert s.page.is_disabled('#arm') and s.page.is_disabled('#start')
    s.click('nav [data-page=setup]')
    s.page.set_input_files('#f-upload', part)
    s.has_value('#f-part', 'block.stl')
    assert s.page.locator('#f-part option[value="jaw_nominal.stl"]').count() == 1  # of the demo
    s.page.select_option('#f-as_found', 'block_worn.stl')
    s.click('#load')
    s.shows('#job-name', 'loaded: block.stl')
    s.click('#preview')
    s.visible('#preview-picture')
    assert 'layer' in s.page.text_content('#preview-table')
    s.picture('setup')

    # arm, start, pause, resume
    start(s)
    gets_to(s, 'DEPOSITING')
    s.page.keyboard.press('Escape')
    gets_to(s, 'PAUSED')
    s.shows('#arc-state', 'off')

    # an alarm at the next arc: what to do, acknowledge
    fault = InjectFault.Request(fault='arc_loss', value=900.0)
    client.call(InjectFault, 'cell/inject_fault', fault)
    s.click('#resume')
    s.shows('#alarm-list', 'E20[45]')
    s.shows('#banner-text', '→')
    s.click('nav [data-page=alarms]')
    s.visible('.alarm .todo')
    s.picture('alarms')
    if not s.page.is_disabled('#pause') or s.page.is_visible('#resume'):
        s.click('#stop')
    s.shows('#job-state', 'FAILED|ABORTED')
    s.shows('#machine-state', 'IDLE')
    client.call(InjectFault, 'cell/inject_fault', InjectFault.Request(fault='none'))
    s.click('#ack-all')
    s.visible('#banner', False)

    # start again, finish, open the report
    s.click('nav [data-page=setup]')
    s.page.fill('#f-name', 'second')
    s.page.fill('#f-operator_name', 'Kim')
    s.page.fill('#f-wire_lot', 'lot 4711')
    s.click('#load')
    s.shows('#toast', 'loaded')
    start(s)
    if PICTURES:
        gets_to(s, 'DEPOSITING 2')
        pictures_of_a_bead(s)
    gets_to(s, 'DONE')
    s.click('nav [data-page=jobs]')
    s.shows('#job-list tr:nth-child(2)', 'second')
    with s.context.expect_page() as opened:
        s.click('#job-list tr:nth-child(2) a')
    report = opened.value
    report.wait_for_load_state()
    assert 'TOLERANCE' in report.text_content('.verdict')
    assert 'lot 4711' in report.text_content('body') and 'Kim' in report.text_content('body')
    s.picture('jobs')
    assert s.said == []


def refused_restart(said: str) -> bool:
    """What the console says of the answer to *Restart programs* before STOP."""
    return 'restart_programs' in said or '(Conflict)' in said


def test_a_dead_job_sequencer_is_said_and_started_again_from_the_page(cell, browser):
    """In the arc. After STOP the page leads out: no command line is needed."""
    address, _, part, state = cell
    s = Screen(browser, 1280, 800)
    s.page.goto(address)
    s.shows('#machine-state', 'ALARM|IDLE')
    if s.page.text_content('#machine-state') == 'ALARM':  # just switched on
        s.click('nav [data-page=move]')
        s.click('#reset')
    s.shows('#machine-state', 'IDLE')
    s.click('nav [data-page=setup]')
    s.page.set_input_files('#f-upload', part)
    s.has_value('#f-part', 'block.stl')
    s.page.select_option('#f-as_found', 'block_worn.stl')
    s.page.fill('#f-tolerance_mm', '0,3')
    s.click('#load')
    s.shows('#said-text', 'tolerance 0.3 mm')
    start(s)
    gets_to(s, 'DEPOSITING')
    s.shows('#arc-state', 'ON')
    os.kill(state.nodes['job_sequencer'].pid, signal.SIGKILL)
    s.shows('#job-state', '^not known$')
    s.shows(
        '#said-text', 'What the job does is not known: job_sequencer does not answer.*The machine: '
    )
    s.shows('#arc-state', 'off')  # the lease has run out
    s.click('#said-restart')
    s.shows('#toast', 'press STOP first')
    s.click('#stop')
    s.shows('#machine-state', 'IDLE')
    s.click('#said-restart')
    s.shows('#toast', r'started again: job_sequencer \(killed by SIGKILL\)')
    s.shows('#job-state', 'no job')
    s.shows('#job-detail', 'ended unknown: job_sequencer died')
    s.click('nav [data-page=jobs]')
    s.shows('#job-list tr:nth-child(2)', 'INTERRUPTED')
    s.page.wait_for_selector('#arm:enabled')
    s.click('#arm')  # the new one is not taken for a second beside the dead one
    s.shows('#machine-detail', 'ARMED')
    s.click('nav [data-page=move]')
    s.click('#disarm')
    assert [t for t in s.said if not refused_restart(t)] == []


# ---- without ROS: the page itself


SIZES = {
    'desk': (1280, 800),
    'tablet_upright': (768, 1024),
    'small_phone': (320, 568),
    'phone_on_its_side': (844, 390),
}
PAGES = ('run', 'setup', 'move', 'alarms', 'jobs', 'machine', 'standoff')
LAYOUT = """() => {
  const all = [...document.querySelectorAll('button, select, input, td a')];
  const found = all.filter((e) => e.offsetParent && e.type !== 'hidden');
  const boxes = found.map((e) => [e.id || e.textContent.trim() || e.title, e.getBoundingClientRect(), e]);
  const bad = [];
  for (const [name, b] of boxes) {
    if (b.width < 47.5 || b.height < 47.5) bad.push(`${name}: ${b.width} x ${b.height}`);
    if (b.left < 0 || b.right > innerWidth) bad.push(`${name} leaves the screen`);
  }
  for (const [i, [name, a, e]] of boxes.entries()) for (const [other, b, f] of boxes.slice(i + 1)) {
    const over = a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
    const scrolled = Boolean(e.closest('main')) !== Boolean(f.closest('main'));
    if (over && !scrolled) bad.push(`${name} over ${other}`);
  }
  const labelled = '.page.on, .value, .over, .over b, nav button, .act, .stop, label, .tabs button';
  for (const e of document.querySelectorAll(labelled)) {
    if (e.offsetParent && e.scrollWidth > e.clientWidth + 1) bad.push(`${e.id || e.textContent.trim()} is cut off`);
  }
  return bad;
}"""
STOP_IS_WHOLE = """() => {
  const stop = document.getElementById('stop'), b = stop.getBoundingClientRect(), bad = [];
  const inside = b.left >= 0 && b.top >= 0 && b.right <= innerWidth && b.bottom <= innerHeight;
  if (!inside) bad.push(`STOP leaves the screen: ${JSON.stringify(b)}`);
  const large = b.width >= 88 && b.height >= 47.5 && stop.scrollWidth <= stop.clientWidth;
  if (!large) bad.push(`STOP is too small: ${b.width} x ${b.height}`);
  for (let i = 1; i < 10; i++) for (let k = 1; k < 10; k++) {
    const hit = document.elementFromPoint(b.left + b.width * i / 10, b.top + b.height * k / 10);
    if (hit !== stop) bad.push(`STOP is covered at ${i}, ${k} by ${hit && (hit.id || hit.tagName)}`);
  }
  return bad;
}"""
LABELS = """() => {
  const bad = [], texts = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode, owner = node.parentElement;
    if (!node.data.trim() || !owner.offsetParent || owner.closest('select, #toast, script')) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    for (const b of range.getClientRects()) {
      if (b.width < 1 || b.height < 1) continue;
      let box = { left: b.left, right: b.right, top: b.top, bottom: b.bottom };
      for (let e = owner; e; e = e.parentElement) {  // what is clipped or scrolled away is not seen
        if (getComputedStyle(e).overflowX === 'visible') continue;
        const c = e.getBoundingClientRect();
        box = { left: Math.max(box.left, c.left), right: Math.min(box.right, c.right),
          top: Math.max(box.top, c.top), bottom: Math.min(box.bottom, c.bottom) };
      }
      if (box.right - box.left > 1 && box.bottom - box.top > 1) texts.push([node.data.trim(), box, owner]);
    }
  }
  for (const [i, [name, a, e]] of texts.entries()) for (const [other, b, f] of texts.slice(i + 1)) {
    if (e === f) continue;
    const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (wide > 2 && high > 4) bad.push(`"${name}" over "${other}"`);  // lines of a font are higher than its letters
  }
  return bad;
}"""


def show_a_job(panel) -> None:
    """Everything that takes room: a long name, an alarm, values with all their digits."""
    put = panel.cell.mailbox.put
    put(('anomaly', {'class': 'scan', 'severity': 1, 'text': 'dirty'}))
    frame = Sample(
        t=1.0, position=(-123.456, 123.456, -99.9), current=288.0, voltage=28.8, feed_commanded=0.2, feed=0.2,
        speed=0.055, state='RUN', arc=True, arc_enabled=True, gas=True, speed_override=1.25, wire_override=1.25,
        lease_left=0.4, wire_feed='underfeed',
    )  # fmt: skip
    put(('telemetry', frame))
    job = dict.fromkeys(('layer', 'layers', 'bead', 'beads'), 108) | {
        'id': '20260101_jaw_restoration_2',
        'dir': '',
    }
    job |= {'state': 'CORRECTING', 'rms_mm': 0.123, 'max_mm': 0.4, 'k_gain': 0.2, 'progress': 0.5}
    job |= {'time_left': 5400.0, 'error_code': 0, 'message': '', 'material': 'er70s-6'}
    put(('job', job))
    heat = {'factor': 1.0, 'temperature': 148.0, 'rate': -0.1, 'limit': 180.0, 'ready': False}
    put(('heat', heat | {'wait': 130.0, 'plausible': True, 'reasons': []}))
    put(('temperature', {'value': 1148.0}))
    standoff = {'source': 'laser', 'set_mm': 100.0, 'measured_mm': 99.87, 'correction_mm': -3.99}
    put(('standoff', standoff | {'alarm': 'contradicts the arc'}))


@pytest.mark.parametrize('size', SIZES.values(), ids=SIZES)
def test_stop_is_whole_targets_fit_gloves_and_nothing_overlaps(panel, browser, size):
    show_a_job(panel)
    s = Screen(browser, *size, has_touch=True)
    s.page.goto(panel.url)
    s.visible('#banner')
    s.shows('#o-speed', '125 %')
    for name in PAGES:
        s.page.tap(f'nav [data-page={name}]')
        s.visible(f'#{name}')
        found = [s.page.evaluate(check) for check in (STOP_IS_WHOLE, LAYOUT, LABELS)]
        assert found == [[], [], []], name
        s.page.evaluate('scrollTo(0, document.body.scrollHeight)')
        assert s.page.evaluate(STOP_IS_WHOLE) == [], name
        s.page.evaluate('scrollTo(0, 0)')
    s.page.evaluate("document.body.classList.add('lost')")
    assert s.page.evaluate(STOP_IS_WHOLE) == []
    assert s.said == []


def test_after_a_fault_of_a_drive_the_place_is_shown_as_unknown_and_the_way_out_is_said(
    panel, browser
):
    put = panel.cell.mailbox.put
    s = Screen(browser, 1280, 800)
    s.page.goto(panel.url)
    s.click('nav [data-page=move]')
    put(('machine', MACHINE | {'homed': True}))
    s.shows('#p-note', 'mm from the work zero')
    lost = {'state': 'ALARM', 'fault': 308, 'fault_text': 'fault of a drive', 'homed': False}
    put(('machine', MACHINE | lost))
    s.shows('#p-note', 'not homed: where it stands is not known')
    assert s.page.eval_on_selector('#position', 'e => e.classList.contains("unknown")')
    s.shows('#banner', 'E308.*drives off.*')
    assert s.page.is_enabled('#reset') and s.page.is_disabled('#home')
    s.click('nav [data-page=alarms]')
    s.shows('#alarms', 'the torque is off.*When no driver reports a fault press Reset, then Home')
    put(('machine', MACHINE | {'homed': False}))
    s.click('nav [data-page=move]')
    s.shows('#p-note', 'not homed')
    s.page.wait_for_selector('#home:enabled')
    assert s.said == []


def test_the_wander_of_the_tip_is_asked_for_where_the_arc_is_the_sensor(panel, browser):
    s = Screen(browser, 1280, 800)
    s.page.goto(panel.url)
    s.click('nav [data-page=standoff]')
    s.has_value('#s-source', 'laser')
    s.visible('#s-wander_mm', False)
    s.page.select_option('#s-source', 'arc')
    s.has_value('#s-wander_mm', '1.6')
    s.visible('#s-wander-help')
    s.page.fill('#s-wander_mm', '0.8')
    s.click('#s-apply')
    s.shows('#toast', '.')
    (name, wanted), *_ = panel.operations.asked
    assert (name, wanted.source) == ('set_standoff', 'arc')
    assert wanted.wander == pytest.approx(0.0008)
    assert s.said == []


def test_the_rerun_viewer_is_embedded(panel, browser, tmp_path):
    """The dashboard tells where its viewer is; the page shows it at full width instead of its own plots."""
    import rerun as rr

    from waam_view.drawing import free_port
    from waam_view.web_viewer import WebViewer

    recording = rr.RecordingStream('waam_test')
    recording.save(tmp_path / 'job.rrd')
    recording.log('arc/current', rr.Scalars([100.0]))
    recording.disconnect()
    viewer = WebViewer(str(tmp_path / 'job.rrd'), free_port(), free_port())
    row = {'node': 'dashboard', 'level': 0, 'message': 'ok', 'viewer': viewer.url, 'restarted': ''}
    panel.cell.mailbox.put(('diagnostics', [row]))
    context = browser.new_context()
    page = context.new_page()  # nobody listens to its console: the viewer says every shader there
    page.set_default_timeout(PATIENCE_MS)
    try:
        page.goto(panel.url)
        page.click('#viewer-tab')
        page.frame_locator('#viewer').locator('canvas.visible').wait_for()
        assert page.get_attribute('#viewer', 'src') == viewer.url
        assert page.is_hidden('#plots') and page.is_visible('#o-speed')
        page.eval_on_selector('[data-map=error]', 'tab => tab.click()')
        assert page.is_hidden('#viewer') and page.is_visible('#plots')
    finally:
        context.close()
        viewer.close()


def test_a_lost_panel_is_said_at_once_and_an_old_page_can_still_stop(make_panel, browser):
    panel = make_panel()
    s = Screen(browser, 1280, 800)
    s.page.goto(panel.url)
    s.visible('#lost', False)
    panel.server.close()
    s.visible('#lost')
    s.click('#stop')
    s.shows('#toast', 'cannot be reached.*emergency stop')


def test_without_any_script_stop_still_works(panel, browser):
    s = Screen(browser, 1280, 800, java_script_enabled=False)
    s.page.goto(panel.url)
    s.click('#stop')
    s.visible('#lost')
    assert panel.operations.asked == [('stop',)]


ATTACK = """async (target) => {
  const tried = [];
  const note = (name) => (e) => tried.push(name);
  for (const type of ['text/plain', 'application/json']) {
    const options = { method: 'POST', mode: 'no-cors', credentials: 'include' };
    const headers = { 'Content-Type': type };
    await fetch(`${target}/api/home`, { ...options, body: '{}', headers }).catch(note('home'));
    await fetch(`${target}/api/stop`, options).catch(note('stop'));
  }
  const form = document.createElement('form');
  Object.assign(form, { method: 'post', action: `${target}/api/stop`, target: 'f' });
  const frame = Object.assign(document.createElement('iframe'), { name: 'f' });
  document.body.append(frame, form);
  form.submit();
  await new Promise((done) => { frame.onload = done; setTimeout(done, 3000); });
  const read = await fetch(`${target}/`).then((a) => a.text()).catch(() => 'refused');
  const stream = await new Promise((done) => {
    const s = new WebSocket(target.replace('http', 'ws') + '/stream');
    s.onmessage = () => done('open'); s.onerror = () => done('refused'); s.onclose = () => done('refused');
  });
  return { read, stream };
}"""


def test_a_page_of_another_origin_reaches_nothing(make_panel, browser):
    target, other = make_panel(), make_panel()
    s = Screen(browser, 800, 600)
    s.page.goto(f'{other.url}/api/choices')  # an origin like any other: same host, another port
    s.page.goto('about:blank')
    s.page.route(
        'http://evil.example/', lambda r: r.fulfill(body='<body></body>', content_type='text/html')
    )
    for place in (f'{other.url}/api/jobs', 'http://evil.example/'):
        s.page.goto(place)
        assert s.page.evaluate(ATTACK, target.url) == {'read': 'refused', 'stream': 'refused'}
    assert target.operations.asked == []


@pytest.mark.parametrize('size', (SIZES['desk'], SIZES['small_phone']), ids=('desk', 'small_phone'))
def test_all_jobs_are_charted_and_filtered(panel, browser, made_jobs, size):
    rms = [0.09, 0.1, 0.11, 0.1, 0.09, 0.11, 0.1, 0.09, 0.1, 0.11, 0.1, 0.6]
    for n, value in enumerate(rms, 1):
        made_jobs(n, rms=value * 1e-3, operator='Ada' if n % 2 else '<b>Kim</b>', arrays=False)
    s = Screen(browser, *size, has_touch=True)
    s.page.goto(panel.url)
    s.page.tap('nav [data-page=jobs]')
    s.page.tap('#jobs-all')
    s.shows('#archive-note', r'^12 jobs\..*nelson 1: a point beyond')
    assert s.page.locator('#archive-list tr').count() == 13
    assert [s.page.evaluate(check) for check in (STOP_IS_WHOLE, LAYOUT, LABELS)] == [[], [], []]
    if size == SIZES['desk']:
        s.picture('jobs_all')
    s.page.fill('#a-operator', 'kim')
    s.page.keyboard.press('Enter')
    s.shows('#archive-note', '^6 jobs')
    s.shows(
        '#archive-list tr:nth-child(2) td:nth-child(6)', r'^<b>Kim</b>, 4711$'
    )  # text, not markup
    s.page.select_option('#a-figure', 'deposition')
    s.shows('#archive-note', '^6 jobs.*No rule is broken')
    s.page.fill('#a-operator', "'; DROP TABLE jobs; --")
    s.page.keyboard.press('Enter')
    s.shows('#archive-note', '^0 jobs')
    s.page.fill('#a-operator', '')
    s.page.keyboard.press('Enter')
    s.shows('#archive-note', '^12 jobs')
    link = s.page.get_attribute('#archive-list tr:nth-child(2) a', 'href')
    assert link.startswith('/jobs/') and link.endswith('_12/report.html')
    assert s.said == []
