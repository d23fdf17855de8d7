"""The page Commissioning in a browser on a simulated cell as delivered: the wizard of `waam commission` behind it."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from test_browser import CHROMIUM, PICTURES, Screen

from waam_bringup import cell_graph, cli
from waam_bringup.commission_cell import CommissionedCell
from waam_bringup.commission_hand import Hand, write_pad
from waam_bringup.commission_visit import Question
from waam_bringup.graph import Settings
from waam_bringup.operate import graph
from waam_msgs.srv import InjectFault
from waam_node.testing import fresh_domain
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
    s.visible('body:not(.lost) #machine-tile')  # its script listens
    s.click('nav [data-page=commission]')
    return s


def step(name: str) -> str:
    """Selector of a step in the list."""
    return f'#c-steps li:has(summary b:text-matches(" {name}$"))'


def test_a_step_is_answered_and_passes_and_another_one_stops_with_its_reason(delivered, browser):
    address, client, tokens = delivered
    s = signed_in(browser, address, tokens[Role.OPERATE])
    s.shows('#c-start', 'Start with link')

    # all that is due: the first two need nobody, the third finds what is wrong
    s.click('#c-start')
    s.shows('#c-text', 'Release the emergency stop')
    s.click('#c-answers button')
    s.shows('#c-ended', 'Stopped at estop: released, the controller says: .*still active')
    s.shows('#c-ended', 'What can be done: its contact is reversed')
    s.shows('#c-head', f'{NAME}: 2 of 20 steps passed')
    s.shows('#c-start', 'Go on with estop')
    s.picture('commission_stopped')

    # one step with a question; who only looks may not answer, and a reload asks it again
    s.page.click(f'{step("temperature")} summary')
    s.page.click('button:text-is("Run only temperature")')
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


OFF = {
    'arc_wire_ratio': 1.041, 'arc_wire_delay': 0.045, 'arc_wire_lag': 0.09, 'delivered_skew': 0.18,
    'delivered_current_scale': 1.048, 'delivered_voltage_scale': 0.953, 'pyrometer_emissivity': 0.62,
    'delivered_scanner_x': 0.004, 'delivered_scanner_y': -0.005, 'delivered_scanner_yaw': 2.0,
    'delivered_scanner_late': 0.08,
}  # fmt: skip
STEPS = (328.7, 312.4, 325.1)  # per mm, of the machine; the controller has 320


@pytest.mark.skipif(not PICTURES, reason='takes four minutes: WAAM_SCREENSHOTS=FOLDER')
def test_from_the_board_to_the_report_of_the_first_part(tmp_path, monkeypatch, browser):
    """A person presses, measures and clicks; the graph is started once more in between."""
    for name in ('JOBS', 'CELLS', 'CALIBRATIONS'):
        monkeypatch.setenv(f'WAAM_{name}', str(tmp_path / name.lower()))
    monkeypatch.setenv('WAAM_CELL', 'gantry1')
    monkeypatch.chdir(tmp_path)  # paths are shown as a person knows them
    assert cli.main(['cell', 'new', 'gantry1']) == 0
    nominal, worn = write_pad(tmp_path)
    file = tmp_path / 'delivered.yaml'
    file.write_text(yaml.safe_dump({'/**/cell': {'ros__parameters': OFF}}))
    settings = Settings(
        run=tmp_path / 'run',
        seed=3,
        machine_steps=STEPS,
        params_files=(file,),
        without=('dashboard',),
    )
    said = []
    for _ in range(2):
        applied = cell_graph.apply(settings, True).settings
        with (
            graph(applied, fresh_domain(), timeout=90.0) as (state, _),
            CommissionedCell(state.domain) as cell,
        ):
            cell.meet_cell()
            s = Screen(browser, 1366, 768)
            s.page.goto(f'{state.panel_url}#commission')
            s.click('#c-start')
            said.append(walk(s, Hand(cell, 0, nominal, worn), nominal))
            if len(said) == 2:
                look_back(s)
    assert 'waam up --cell gantry1, and go on' in said[0] and said[1] == 'Done.'


def walk(s: Screen, hand: Hand, nominal: Path) -> str:
    """Does and answers what is asked until the run ends; how."""
    while True:
        s.page.wait_for_selector(
            '#c-answers button:not([disabled]), #c-asked:not(:has(button)), #c-ended:visible'
        )
        if s.page.is_visible('#c-ended'):
            return s.page.text_content('#c-ended')
        if not s.page.is_visible('#c-asked'):
            continue
        action, text = s.page.get_attribute('#c-asked', 'data-id'), s.page.text_content('#c-text')
        number = s.page.get_attribute('#c-asked', 'data-number')
        if action == 'steps.x':
            pictures_of_a_question(s)
        labels = s.page.locator('#c-answers button').all_text_contents()
        if labels in ([], ['Done']):
            hand.do(action, text, bool(labels))
        answer = hand.ask(Question(action, text)) if labels not in ([], ['Done']) else 'Done'
        if labels:
            give(s, answer, nominal)
        s.page.wait_for_function(GONE, arg=number)


def pictures_of_a_question(s: Screen) -> None:
    """On a desk and on a phone."""
    s.picture('commission')
    s.page.set_viewport_size({'width': 390, 'height': 844})
    s.page.locator('#c-asked').scroll_into_view_if_needed()
    s.picture('commission_phone')
    s.page.set_viewport_size({'width': 1366, 'height': 768})


GONE = "(n) => { const f = document.querySelector('#c-asked'); return f.hidden || f.dataset.number !== n; }"


def give(s: Screen, answer: str, nominal: Path) -> None:
    """As a person gives it: a part from the list, numbers in their fields, else a button."""
    if s.page.is_visible('#c-part'):
        s.page.set_input_files('#c-upload', nominal)
        s.has_value('#c-part', nominal.name)
        answer = 'Begin with this part'
    elif count := s.page.locator('#c-answers input').count():
        for i, number in zip(range(count), answer.split(), strict=True):
            s.page.fill(f'#c-number-{i}', f'{float(number):.2f}')
        answer = 'Enter'
    s.page.click(f'#c-answers button:text-is("{answer[0].upper()}{answer[1:]}")')


def look_back(s: Screen) -> None:
    """Evidence of the scanner, the page to sign and the report of the part."""
    s.page.click(f'{step("scanner")} summary')
    shown = s.page.locator(f'{step("scanner")} img')
    shown.scroll_into_view_if_needed()
    s.page.wait_for_function(
        "[...document.querySelectorAll('#c-steps img')].some((i) => i.naturalWidth > 0)"
    )
    shown.scroll_into_view_if_needed()
    s.picture('commission_evidence')
    for link, wanted in (
        ('#c-page', 'Commissioning of the cell gantry1'),
        ('#c-report', 'cleans up'),
    ):
        with s.context.expect_page() as opened:
            s.page.click(link)
        opened.value.wait_for_selector(f'text={wanted}')
