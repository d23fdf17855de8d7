"""The page Commissioning in a browser on a simulated cell as delivered: the wizard of `waam commission` behind it."""

from __future__ import annotations

import pytest
import yaml
from test_browser import CHROMIUM, Screen

from waam_bringup import cli
from waam_bringup.graph import Settings
from waam_bringup.operate import graph
from waam_msgs.srv import InjectFault
from waam_shop.roles import Role
from waam_shop.shop_folder import Shop

pytest.importorskip('playwright', reason='playwright is not installed (pip install playwright)')
pytestmark = pytest.mark.skipif(not CHROMIUM, reason='chromium is not installed (apt-get)')
NAME = 'hidden'
RUNS_NOT = (
    'scan_fusion', 'correction_server', 'feed_forward', 'thermal_compensator', 'process_control', 'recorder',
    'dashboard',
)  # fmt: skip


@pytest.fixture
def delivered(tmp_path, monkeypatch, domain):
    """A cell whose emergency stop is connected the wrong way: page, client of the graph, tokens by role."""
    for name in ('JOBS', 'CELLS', 'CALIBRATIONS'):
        monkeypatch.setenv(f'WAAM_{name}', str(tmp_path / name.lower()))
    monkeypatch.setenv('WAAM_CELL', NAME)
    assert cli.main(['cell', 'new', NAME]) == 0
    shop = Shop(tmp_path / 'jobs' / '.shop')
    tokens = {role: shop.tokens().create(role.label, role) for role in (Role.VIEW, Role.OPERATE)}
    file = tmp_path / 'delivered.yaml'
    told = {
        'cell': {'delivered_estop': 'reversed'},
        'panel': {'token_file': str(next(shop.path.glob('tokens*')))},
    }
    file.write_text(yaml.safe_dump({f'/**/{n}': {'ros__parameters': v} for n, v in told.items()}))
    settings = Settings(run=tmp_path / 'run', seed=3, params_files=(file,), without=RUNS_NOT)
    with graph(settings, domain, timeout=90.0) as (state, client):
        yield state.panel_url, client, tokens


def signed_in(browser, address: str, token: str) -> Screen:
    s = Screen(browser, 1366, 768)
    s.page.goto(address)
    s.page.fill('[name=token]', token)
    s.page.keyboard.press('Enter')
    s.visible('#machine-tile')
    s.click('nav [data-page=commission]')
    return s


def step(s: Screen, name: str) -> str:
    return f'#c-steps li:has(summary b:text-is("{name}"))'


def test_a_step_is_answered_and_passes_and_another_one_stops_with_its_reason(delivered, browser):
    address, client, tokens = delivered
    s = signed_in(browser, address, tokens[Role.OPERATE])
    s.shows('#c-start', 'Start with link')

    # all that is due: the first two need nobody, the third finds what is wrong
    s.click('#c-start')
    s.shows('#c-ended', 'Stopped at estop: released, the controller says: .*still active')
    s.shows('#c-ended', 'What can be done: its contact is reversed')
    s.shows('#c-head', f'{NAME}: 2 of 20 steps passed')
    s.shows('#c-start', 'Go on with estop')

    # one step with a question; who only looks may not answer, and a reload asks it again
    s.page.click(f'{step("temperature")} summary')
    s.page.click('button:text-is("Only temperature")')
    s.shows('#c-text', 'hand thermometer')
    looks = signed_in(browser, address, tokens[Role.VIEW])
    looks.page.fill('#c-number-0', '22')
    looks.page.click('#c-answers button')
    looks.shows('#c-wrong', 'role')
    looks.page.click('#c-end')
    looks.shows('#toast', 'role')
    s.page.reload()
    s.shows('#c-text', 'hand thermometer')
    assert s.page.is_visible('#stop'), 'as on every page'
    s.page.fill('#c-number-0', '2200')
    s.page.click('#c-answers button')
    s.shows('#c-wrong', '2200, must be')
    s.page.fill('#c-number-0', '22,0')
    s.page.click('#c-answers button')
    s.shows('#c-text', 'Warm that place')
    client.call(
        InjectFault, 'cell/inject_fault', InjectFault.Request(fault='warm_hand', value=15.0)
    )
    s.shows('#c-text', 'Take it away')
    s.page.click('button:text-is("Done")')
    s.shows('#c-ended', 'Done')
    s.shows(f'{step("temperature")} summary', 'passed 20')
    looks.shows(f'{step("temperature")} summary', 'passed 20')
    found = s.page.text_content(step('temperature'))
    assert 'told: 22' in found and ' K' in found and '✓' in found
    with s.context.expect_page() as opened:
        s.page.click('#c-page')
    opened.value.wait_for_selector('h1')
    assert 'This cell is not ready' in opened.value.text_content('body')
