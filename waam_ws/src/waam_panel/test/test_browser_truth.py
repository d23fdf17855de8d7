"""Nothing that is not known looks known: every field of the page, and what becomes of it when its source dies.

Which field comes from which section is found out, not listed: a field is what changes when the section says other
values. So a new field is looked at, too.
"""

from __future__ import annotations

import numpy as np
import pytest
from panel_requests import MACHINE
from test_browser import CHROMIUM, Screen, refused_restart

from waam_panel import pictures
from waam_panel.sources import PROGRAMS, SOURCES
from waam_process.grid import GridSpec

pytest.importorskip('playwright', reason='playwright is not installed (pip install playwright)')
pytestmark = pytest.mark.skipif(not CHROMIUM, reason='chromium is not installed (apt-get)')
GRID = GridSpec(0.0, 0.0, 1e-3, 8, 10)


def height(n: int) -> dict:
    width = {
        'layer': n,
        'width_mm': 6.0 + n,
        'u_mm': 0.1 * n,
        'expected_mm': 6.1 + n,
        'sections': 40 + n,
    }
    z = np.full(GRID.shape, n * 1e-3)
    return {
        'picture': pictures.height_map(GRID, z) | {'title': f'scan {n}'}, 'job_id': 'j', 'scan_id': n, 'layer': n,
        'spec': GRID, 'z': z, 'time': float(n), 'width': width,
    }  # fmt: skip


def correction(n: int) -> dict:
    psi = pictures.encode_map(GRID, np.zeros(GRID.shape), -1.0, 1.0, 1e4) | {
        'title': f'for layer {n}'
    }
    return {'psi': psi, 'reasons': [], 'fallback': False, 'width_ratio': 1.0 + n / 10}


def values(panel, n: int) -> dict[str, object]:
    """What every section says, for n = 1 and 2: no value is the same, and all of it is possible beside the rest."""
    machine = {
        'homed': n == 1, 'armed': n == 1, 'armed_job': f'job {n}', 'port': f'/dev/tty{n}', 'identity': f'WAAM_{n}',
        'firmware': f'1.{n}', 'capabilities': [f'C{n}'], 'fault': 100 + n, 'fault_text': f'text {n}',
        'message': f'm {n}', 'work_offset': [n, 1.0, 2.0], 'limit_min': [-n, 0.0, 0.0], 'state': 'RUN',
    }  # fmt: skip
    frame = {
        'position': (n / 100, n / 50, n / 30), 'current': 100.0 * n, 'voltage': 20.0 + n, 'feed': 0.1 * n,
        'speed': 0.01 * n, 'feed_commanded': 0.11 * n, 'state': ('RUN', 'IDLE')[n - 1], 'arc': n == 1,
        'arc_enabled': n == 1, 'gas': n == 1, 'speed_override': 1 + n / 10, 'wire_override': 1 + n / 20,
        'wire_feed': ('feed normal', 'underfeed')[n - 1], 't': float(n),
    }  # fmt: skip
    job = {
        'state': ('DEPOSITING', 'SCANNING')[n - 1],
        'bead': n,
        'k_gain': n / 10,
        'rms_mm': n / 10,
        'progress': n / 10,
        'time_left': None,  # else it counts down, and the page never comes to rest
    }
    return {
        'machine': MACHINE | machine, 'telemetry': panel.still(**frame), 'job': panel.job(**job),
        'link': {'rate': 100.0 + n, 'round_trip_ms': 3.0 * n, 'lost': n, 'resends': n, 'queued': n},
        'heat': {'factor': 1.0, 'temperature': 100.0, 'rate': 1.0, 'limit': 150.0 + n, 'ready': n == 1, 'wait': 60.0,
                 'plausible': True, 'reasons': []},
        'temperature': {'value': 100.0 + n},
        'standoff': {'source': ('laser', 'arc')[n - 1], 'set_mm': 100.0 + n, 'measured_mm': 99.0 + n,
                     'correction_mm': n / 2, 'alarm': ('', 'frozen')[n - 1]},
        'process': {'value': ('current', 'power')[n - 1], 'unit': ('A', 'W')[n - 1], 'set': 100.0 + n,
                    'measured': 90.0 + n, 'speed': 1 + n / 100, 'wire': 1 + n / 50, 'limited': n == 2, 'frozen': '',
                    'operator_speed': 1 + n / 20, 'operator_wire': 1 + n / 10},
        'height': height(n), 'correction': correction(n),
    }  # fmt: skip


FIELDS = """() => {
  const key = (e) => {
    const parts = [];
    for (; e?.parentElement && !e.id; e = e.parentElement) parts.unshift([...e.parentElement.children].indexOf(e));
    return `${e ? e.id : ''}/${parts.join('.')}`;
  };
  const found = {};
  for (const e of document.querySelectorAll('header *, main *')) {
    if (e.children.length && ![...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim())) continue;
    if (e.closest('form, nav, #alarms, #jobs, select, option, .keys')) continue;
    const said = [...e.childNodes].filter((n) => n.nodeType === 3).map((n) => n.data).join('').trim();
    if (said && said !== '–') found[key(e)] = [said, Boolean(e.closest('.stale')), Boolean(e.closest('[hidden]'))];
  }
  return found;
}"""


def settle(s: Screen, unlike: dict[str, str] | None = None) -> dict[str, str]:
    """The texts of all fields once nothing changes any more; with `unlike`, once something has."""
    before: dict = {}
    for _ in range(200):
        s.page.evaluate('new Promise((done) => setTimeout(done, 300))')
        now = {k: text for k, (text, _, hidden) in s.page.evaluate(FIELDS).items() if not hidden}
        if now == before and now != unlike:
            return now
        before = now
    raise AssertionError('the page does not come to rest')


@pytest.fixture
def truth(panel, browser):
    """(page that shows values for every section, panel, {section: fields}, their texts)."""
    first, second = values(panel, 1), values(panel, 2)
    panel.speak(*first.items())
    s = Screen(browser, 1280, 800)
    s.page.goto(panel.url)
    s.click('nav [data-page=machine]')  # its tables are filled while it is open
    s.shows('#job-state', 'DEPOSITING')
    shown, fields = settle(s), {}
    for section, other in second.items():  # one after the other; what has changed stays
        panel.saying[section] = other
        now = settle(s, unlike=shown)
        fields[section] = {k for k in now if shown.get(k) != now[k]}
        shown = now
    return s, panel, fields, shown


def test_every_field_of_a_source_that_died_is_old_or_not_known(truth):
    s, panel, fields, shown = truth
    assert {n for n, found in fields.items() if found} == set(values(panel, 1)), fields
    assert len(set().union(*fields.values())) > 50
    for node in sorted({SOURCES[name].node for name in fields}):
        mine = [name for name in fields if SOURCES[name].node == node]
        looked_at = set().union(*(fields[name] for name in mine))
        kept = dict(panel.saying)
        panel.living = tuple(n for n in PROGRAMS if n != node)
        for name in mine:
            del panel.saying[name]
        present = looked_at
        for _ in range(120):
            s.page.evaluate('new Promise((done) => setTimeout(done, 250))')
            now = s.page.evaluate(FIELDS)
            present = {
                k
                for k in looked_at
                if k in now and now[k][0] == shown[k] and not now[k][1] and not now[k][2]
            }
            if not present:
                break
        assert not present, (node, {k: shown[k] for k in present})
        if node:  # some have one of several publishers
            s.shows('#programs', f'{node}! gone: does not answer')
        panel.living = PROGRAMS
        panel.saying |= kept
        s.none(".stale")  # it is back
    assert s.said == []


def test_a_job_whose_sequencer_died_is_not_known_and_the_page_leads_out(panel, browser):
    frame = panel.still(state='RUN', arc=True, arc_enabled=True)
    armed = values(panel, 1)['machine'] | {'state': 'IDLE'}
    panel.speak(
        ('machine', armed | {'state': 'RUN'}),
        ('telemetry', frame),
        ('job', panel.job('DEPOSITING')),
    )
    s = Screen(browser, 1280, 800)
    s.page.goto(panel.url)
    s.shows('#job-state', 'DEPOSITING 1/3')
    panel.living = tuple(n for n in PROGRAMS if n != 'job_sequencer')
    del panel.saying['job']
    s.shows('#job-state', '^not known$')
    s.shows('#job-detail', r'^job_sequencer does not answer since \d+ s$')
    s.shows('#said-text', 'What the job does is not known.*The machine: RUN, ARMED, arc ON')
    s.shows('#banner', 'A program does not answer.*job_sequencer.*Restart programs')
    s.click('#said-restart')  # not while the arc is on
    s.shows('#toast', 'the arc is on: press STOP first')
    panel.saying |= {'machine': armed, 'telemetry': panel.still()}
    s.shows('#machine-state', 'IDLE')
    assert s.page.is_disabled('#arm') and s.page.is_disabled('#start')
    s.click('nav [data-page=machine]')
    s.shows('#programs', 'job_sequencer! gone')
    s.click('#restart')
    s.shows('#toast', 'restart_programs')
    assert ('restart_programs',) in panel.operations.asked
    log = [e.what for e in panel.cell.shop.audit.last(20)]
    assert 'restart_programs' in log and 'job ends' in log
    ended = next(e for e in panel.cell.shop.audit.last(20) if e.what == 'job ends')
    assert ended.data == {
        'job': '20260101_jaw',
        'state': 'UNKNOWN',
        'why': 'ended unknown: job_sequencer died or hangs',
    }
    panel.living = PROGRAMS
    panel.saying['job'] = panel.job('IDLE')
    s.shows('#job-state', 'no job')
    s.shows('#job-detail', '20260101_jaw ended unknown: job_sequencer died')
    assert [t for t in s.said if not refused_restart(t)] == []


def test_with_a_dead_bridge_no_arc_stays_lit_and_without_the_panel_nothing_is_fresh(panel, browser):
    panel.speak(*values(panel, 1).items())
    s = Screen(browser, 1280, 800)
    s.page.goto(panel.url)
    s.shows('#arc-state', 'ON')
    panel.saying['machine'] = MACHINE | {'connected': False, 'message': 'no answer at the port'}
    s.shows('#machine-state', 'NOT CONNECTED')
    s.shows('#arc-state', '–')
    assert not s.page.eval_on_selector('#arc-tile', 'e => e.classList.contains("lit")')
    panel.saying['machine'] = values(panel, 1)['machine']
    s.shows('#arc-state', 'ON')
    s.context.set_offline(True)  # open sockets live on: the panel falls silent instead
    panel.server.close()
    s.visible('#lost')
    s.shows('#job-state', '^not known$')
    s.shows('#arc-state', '–')
    old = s.page.eval_on_selector_all(
        '[data-from]', 'all => all.filter((e) => !e.classList.contains("stale")).length'
    )
    assert old == 0
