"""The banner: every alarm of the table whole at every size, never over STOP, and the one that says most."""

from __future__ import annotations

import pytest
from panel_requests import MACHINE
from test_browser import CHROMIUM, STOP_IS_WHOLE, Screen

from waam_panel import alarms
from waam_panel.alarms import AlarmLog

pytest.importorskip('playwright', reason='playwright is not installed (pip install playwright)')
pytestmark = pytest.mark.skipif(not CHROMIUM, reason='chromium is not installed (apt-get)')
SIZES = {'phone': (390, 844), 'tablet': (1024, 768), 'desk': (1366, 768)}
CODES = [(kind, code) for kind, rows in alarms.table().items() for code in rows]
TOLD = 'HOLD E204 the current of the arc has vanished at x 123.456 y 123.456 z 12.345 (layer 12, bead 34)'
SHOW_ALL = """async (list) => {
  const { clearAlarms, showAlarms } = await import('/static/alarms.js');
  const bad = [], date = /^\\d{4}-\\d\\d-\\d\\d \\d\\d:\\d\\d:\\d\\d$/;
  const banner = document.getElementById('banner'), wanted = (a) => `${a.text || a.cause} → ${a.action}`;
  for (const a of list) {
    clearAlarms();
    showAlarms([a], a.id);
    const parts = [banner, ...banner.querySelectorAll('b, time, span, button')];
    for (const e of parts) {
      if (e.scrollWidth > e.clientWidth + 1 && e.clientWidth) bad.push(`${a.code}: ${e.id} is cut`);
      const b = e.getBoundingClientRect(), over = getComputedStyle(e);
      if (b.left < 0 || b.right > innerWidth + 0.5) bad.push(`${a.code}: ${e.id} leaves the screen`);
      if (over.textOverflow === 'ellipsis' || over.overflow === 'hidden') bad.push(`${a.code}: ${e.id} may be cut`);
      if (e.scrollHeight > e.clientHeight + 1 && e.clientHeight) bad.push(`${a.code}: ${e.id} is cut below`);
    }
    const stop = document.getElementById('stop').getBoundingClientRect(), b = banner.getBoundingClientRect();
    if (b.top < stop.bottom && b.bottom > stop.top && b.right > stop.left) bad.push(`${a.code}: over STOP`);
    if (innerWidth > 560 && b.bottom > innerHeight) bad.push(`${a.code}: leaves the screen below`);
    if (document.getElementById('banner-text').textContent !== wanted(a)) bad.push(`${a.code}: another text`);
    if (!date.test(document.getElementById('banner-when').textContent)) bad.push(`${a.code}: no date`);
  }
  return bad;
}"""


def every_alarm() -> list[dict]:
    """As a page gets them: without the words of a program, with long ones, and in every state of the job."""
    found = []
    for kind, code in CODES:
        for doing in (alarms.RUNNING, alarms.PAUSED, alarms.ENDED):
            log = AlarmLog()
            log.job(alarms.RUNNING)
            log.event(1.0, kind, code, 2, '')
            log.job(doing)
            (a,) = log.listing()
            found += [a, a | {'text': TOLD}]
    return [a | {'id': n, 'time': 1.7e9 + n} for n, a in enumerate(found, 1)]


@pytest.mark.parametrize('size', SIZES.values(), ids=SIZES)
def test_no_alarm_of_the_table_is_cut_and_none_lies_over_stop(panel, browser, size):
    s = Screen(browser, *size)
    s.page.goto(panel.url)
    listed = every_alarm()
    assert len(listed) == 6 * len(CODES) > 300
    s.page.wait_for_selector('body:not(.lost)')
    assert s.page.evaluate(SHOW_ALL, listed) == []
    assert s.page.evaluate(STOP_IS_WHOLE) == []
    assert s.said == []


def test_the_cause_stands_in_the_banner_and_not_over_the_next_job(panel, browser):
    s = Screen(browser, 1280, 800)
    ok = MACHINE | {'homed': True}
    panel.speak(('machine', ok), ('telemetry', panel.still()), ('job', panel.job('DEPOSITING')))
    s.page.goto(panel.url)
    s.shows('#job-state', 'DEPOSITING')
    panel.saying['machine'] = ok | {'state': 'HOLD', 'fault': 204, 'fault_text': 'arc lost'}
    s.shows('#banner', 'E204 Arc lost.*start the job again')
    panel.saying['job'] = panel.job('PAUSED', message='no wire: change the spool, then Resume')
    s.shows('#banner-text', 'The job waits. Change the spool.*Resume')
    s.shows('#said-text', 'PAUSED: no wire: change the spool, then Resume')
    panel.saying['job'] = panel.job('FAILED', error_code=108, message='layer 1: E204 arc lost')
    panel.saying['machine'] = ok
    s.shows('#banner', 'E204 Arc lost.*start the job again')
    s.shows('#alarm-list', 'job 108: Deposition failed')
    panel.saying['job'] = panel.job('DEPOSITING', id='20260102_next')
    s.visible('#banner', False)
    s.shows('#alarm-list', r'E204 Arc lost \(of a job before\)')
    assert s.said == []
