"""What the pages of the report say of worst places, beads, money and what was made good; no cause without a proof."""

import json
import re
import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from synthetic_job import write_job  # noqa: E402

from waam_process.prices import PriceError, Prices  # noqa: E402
from waam_view import canvas, part_picture  # noqa: E402
from waam_view.beads import arc_ends, beads  # noqa: E402
from waam_view.engineer_pages import anomalies_section, beads_section, surface_section  # noqa: E402
from waam_view.job_data import Job, Scan, interpass_limit, load_job  # noqa: E402
from waam_view.owner_page import local_time, owner_page, use_of, verdict_box  # noqa: E402
from waam_view.prices import Use, costs, find_prices, read_prices  # noqa: E402
from waam_view.report import write_report  # noqa: E402
from waam_view.worst_places import worst_places  # noqa: E402

CELL = 1e-3
ROWS, COLS = 30, 60


@pytest.fixture(autouse=True, scope='module')
def coarse_pictures():
    fine, canvas.DPI = canvas.DPI, 40
    cells, part_picture.CELLS = part_picture.CELLS, 12
    yield
    canvas.DPI, part_picture.CELLS = fine, cells


def flat(value=0.0):
    return np.full((ROWS, COLS), float(value))


def job(**changed) -> Job:
    """Two scans around one layer of 2 mm that came as it was set and as it was needed."""
    region = np.ones((ROWS, COLS))
    before = {
        'z': flat(), 'target': flat(), 'nominal': flat(2e-3), 'region': region, 'interior': region, 'asked': flat(2e-3),
        'planned': flat(2e-3), 'psi': flat(), 'count': flat(9),
    }  # fmt: skip
    after = {
        'z': flat(2e-3), 'target': flat(2e-3), 'nominal': flat(2e-3), 'region': region, 'interior': region,
        'count': flat(9),
    }  # fmt: skip
    scans = [Scan(0, (0.0, 0.0), CELL, before), Scan(1, (0.0, 0.0), CELL, after)]
    asked = {
        'material': {'bead_width': 6e-3},
        'parameters': {'interpass_limit': 150.0, 'share_in_tolerance': 0.95},
    }
    whole = Job(
        Path('.'),
        'closed_loop',
        {'tolerance_mm': 0.2},
        {'verdict': 'in tolerance'},
        scans,
        {},
        asked,
    )
    return replace(whole, **changed)


def dent(of: Job, row: int, col: int, metres: float, scan: int = 1, name: str = 'z') -> None:
    """Nine cells, the middle one a little more: it is the worst."""
    of.scans[scan].maps[name][row - 1 : row + 2, col - 1 : col + 2] += metres
    of.scans[scan].maps[name][row, col] += 1e-3 * metres


def test_the_worst_three_come_in_order_and_apart_from_each_other():
    one = job()
    for col, metres in ((10, -0.5e-3), (16, -0.45e-3), (30, 0.4e-3), (50, -0.3e-3)):
        dent(one, 15, col, metres)
    found = worst_places(one)
    # the second dent lies within two bead widths of the first
    assert [round(p.value_mm, 2) for p in found] == [-0.5, 0.4, -0.3]
    assert all(
        abs(p.x_mm - x) < 2 and abs(p.y_mm - 15.5) < 2
        for p, x in zip(found, (10.5, 30.5, 50.5), strict=True)
    )


def test_metal_that_came_short_has_no_invented_cause():
    one = job()
    dent(one, 15, 30, -0.5e-3)
    assert worst_places(one)[0].causes == [
        'the layer gave 0.50 mm less than was set',
        'cause of that not known',
    ]
    plain = job()
    for name in ('asked', 'planned', 'psi'):
        del plain.scans[0].maps[name]
    dent(plain, 15, 30, -0.5e-3)
    assert worst_places(plain)[0].causes == [] and 'cause not known' in surface_section(
        plain, worst_places(plain)
    )


def test_a_limit_is_named_only_where_the_correction_stood_at_it():
    one = job()
    dent(one, 15, 30, -0.5e-3, scan=0, name='asked')
    dent(one, 15, 30, -0.5e-3)
    told = 'layer 1 was set 0.50 mm less than the target needed'
    assert worst_places(one)[0].causes == [f'{told}; what held it back is not recorded']
    dent(one, 15, 30, 1.0, scan=0, name='psi')  # fast: the other side
    assert worst_places(one)[0].causes == [f'{told}; what held it back is not recorded']
    dent(one, 15, 30, -2.0, scan=0, name='psi')
    assert worst_places(one)[0].causes == [
        f'limit of correction: travel as slow as allowed; {told}'
    ]
    open_loop = replace(one, loop_mode='open_loop')
    assert worst_places(open_loop)[0].causes == ['no correction was applied (open loop)']


def test_arc_heat_blindness_and_sides_are_named_where_they_were_recorded():
    one = job()
    dent(one, 15, 30, 0.5e-3)
    t = np.arange(4.0)
    near = {
        't': t,
        'arc': np.array([0, 1, 1, 0.0]),
        'layer': np.ones(4),
        'x': np.array([0, 0.03, 0.09, 0]),
        'y': flat()[0, :4] + 0.0155,
    }
    layers = [{'layer': 1, 'temperature': 180.0}, {'layer': 2, 'final': True}]
    hot = replace(one, telemetry=near, run={**one.run, 'layers': layers})
    causes = worst_places(hot)[0].causes
    assert any(c.startswith('arc start, ') for c in causes) and not any(
        'arc end' in c for c in causes
    )
    assert 'temperature: the layer began at 180 °C, interpass limit 150 °C' in causes
    assert not any('side' in c or 'seen' in c for c in causes)
    for scan in one.scans:
        scan.maps['nominal'][:, 33:] = np.nan
    dent(one, 15, 30, -9.0, scan=0, name='count')
    one.scans[0].maps['count'] = one.scans[0].maps['count'].clip(0)
    causes = worst_places(one)[0].causes
    assert (
        any(c.startswith('free side, ') for c in causes)
        and 'not seen by the scanner after layer 0' in causes
    )


def test_a_machined_part_is_ranked_by_what_is_left_to_machine():
    one = job(run={'stock': {'share': 0.99, 'below_mm': 0.3}, 'verdict': 'does not clean up'})
    for scan in one.scans:
        scan.maps['target'] = scan.maps['target'] + 0.7e-3 * scan.layer  # allowance
    one.scans[1].maps.update(z=flat(2.7e-3), needed=np.ones((ROWS, COLS)))
    dent(one, 15, 30, -1.0e-3)
    dent(one, 15, 10, 1.5e-3)  # much to machine is not bad
    worst = worst_places(one)[0]
    assert worst.value_mm == pytest.approx(-0.3, abs=2e-3) and worst.errors_mm[-1] == pytest.approx(
        -1.0, abs=2e-3
    )
    assert 'the lowest place is 0.30 mm below it' in verdict_box(one)


def test_beads_run_from_arc_on_to_arc_off_with_their_own_means():
    t = {
        't': 100 + np.arange(10) * 0.1, 'arc': np.array([0, 1, 1, 1, 0, 0, 1, 1, 0, 0.0]),
        'layer': np.array([1.0] * 5 + [2] * 5),
        'current': np.array([0, 100, 110, 120, 0, 0, 50, 50, 0, 0.0]), 'voltage': np.full(10, 20.0),
        'speed': np.full(10, 0.01), 'x': np.arange(10) * 1e-3, 'y': np.zeros(10),
        'arc_changed': np.full(10, np.nan),
    }  # fmt: skip
    t['arc_changed'][[1, 4]] = 100.05, 100.36
    first, second = beads(t)
    assert (first.layer, second.layer) == (1, 2)
    assert first.current == pytest.approx(110) and first.heat_input == pytest.approx(
        110 * 20 / 0.01
    )
    assert first.start == pytest.approx(0.05) and first.duration == pytest.approx(0.31)
    assert second.duration == pytest.approx(
        0.2
    )  # by the rows, where nothing more exact is recorded
    assert np.isnan(second.wire_feed) and np.isnan(second.temperature)
    assert arc_ends(t, 2) == [('arc start', 6e-3, 0.0), ('arc end', 7e-3, 0.0)]
    said = [{'time': 100.2, 'text': 'arc <lost>'}, {'time': 150.0, 'text': 'later'}]
    section = beads_section(job(telemetry=t, run={'anomalies': said}))
    assert section.count('arc &lt;lost&gt;') == 1 and 'later' not in section
    assert 'No telemetry' in beads_section(job())


def test_a_bead_of_a_run_that_was_killed_ends_with_its_run():
    t = {'t': np.array([0, 0.1, 0.2, 7200.0, 7200.1]), 'arc': np.array([1.0, 1, 1, 0, 0])}
    (bead,) = beads(t)
    assert 0.2 <= bead.duration < 2.0


def test_the_interpass_limit_is_that_of_the_node_before_that_of_the_material():
    asked = {'material': {'interpass_limit': 250.0}}
    assert interpass_limit(job(asked=asked)) == 250.0
    asked['nodes'] = {'thermal_compensator': {'interpass_limit': 300.0}}
    assert interpass_limit(job(asked=asked)) == 300.0


def test_an_arc_that_burns_to_the_last_row_is_a_bead_too():
    t = {'t': np.arange(3.0), 'arc': np.array([1.0, 1, 1])}
    assert [(b.start, b.duration) for b in beads(t)] == [(0.0, 2.0)]


@pytest.mark.parametrize(
    'text, said',
    [
        ('currency: EUR\nwire: 3', "'wire' is no price"),
        ('wire_per_kg: 3', 'currency must be'),
        ('currency: EUR\ngas_per_hour: -1', 'gas_per_hour must be'),
        ('currency: EUR\ngas_per_hour: cheap', 'gas_per_hour must be'),
        ('currency: EUR\nnew_part: .inf', 'new_part must be'),
        ('currency: EUR\nnew_part: yes', 'new_part must be'),
        ('- 1', 'no mapping'),
    ],
)
def test_prices_that_are_not_understood_are_refused_by_name(tmp_path, text, said):
    (tmp_path / 'prices.yaml').write_text(text)
    with pytest.raises(PriceError, match=said):
        read_prices(tmp_path / 'prices.yaml')


def test_what_has_no_price_is_not_counted_and_named():
    known, left = costs(
        Prices('EUR', {'default': 4.0}, machine_per_hour=50.0), Use(0.5, 20.0, 0.5, 1.0, 2.0), ''
    )
    assert known == [('wire', 2.0), ('machine', 100.0)] and left == [
        'shielding gas',
        'energy of the arc',
        'labour',
    ]
    unknown = Use(0.5, 20.0, float('nan'), 1.0, 2.0)
    assert costs(Prices('EUR', gas_per_hour=1.0), unknown, '')[0] == []
    by_wire = Prices('EUR', {'316l': 14.0}, labour_per_hour=30.0, labour_share=0.5)
    assert costs(by_wire, unknown, '316l')[0] == [('wire', 7.0), ('labour', 30.0)]
    assert costs(by_wire, unknown, 'er70s-6')[0] == [('labour', 30.0)]


def test_prices_are_looked_for_in_the_job_and_beside_it(tmp_path):
    run = tmp_path / 'jobs' / 'demo' / 'closed_loop'
    run.mkdir(parents=True)
    assert find_prices(run) is None
    (tmp_path / 'prices.yaml').write_text('currency: far')
    (tmp_path / 'jobs' / 'prices.yaml').write_text('currency: EUR')
    assert find_prices(run) is None  # two above, and the folder between is no job
    (run.parent / 'report.json').write_text('{}')
    assert find_prices(run).currency == 'EUR'
    (run / 'prices.yaml').write_text('currency: UAH')
    assert find_prices(run).currency == 'UAH'


def test_money_is_shown_with_prices_only_and_a_new_part_is_compared(tmp_path):
    folder = tmp_path / 'one'
    report = write_job(folder, layers=1)
    one = replace(load_job(folder, report, 'closed_loop'), scans=[])

    def page(prices: str = '') -> str:
        if prices:
            (tmp_path / 'prices.yaml').write_text(prices)
        return owner_page(one, [])

    assert 'No prices are known' in page() and ' EUR' not in page()
    told = page('currency: EUR\nmachine_per_hour: 36\nnew_part: 5')  # 812 s
    assert '8.12 EUR' in told and 'at least 3.12 EUR more than a new part at 5.00 EUR' in told
    assert 'no price or no figure: wire, shielding gas, energy of the arc, labour.' in told
    told = page('currency: EUR\nnew_part: 5')
    assert 'in all' not in told and 'a new part' not in told
    told = page('currency: EUR\nmachine: 36')
    assert 'No money is shown' in told and '&#x27;machine&#x27; is no price' in told


def test_what_a_job_used_is_by_its_material_and_its_plan(tmp_path):
    run = {'wire_m': 100.0, 'arc_on_s': 60.0, 'energy_J': 7.2e6, 'duration_s': 1800}
    asked = {'material': {'wire_diameter': 1.2e-3, 'density': 7850.0}}
    np.savez(tmp_path / 'plan.npz', about=json.dumps({'settings': {'gas_flow': 2.5e-4}}))
    use = use_of(job(folder=tmp_path, run=run, asked=asked))
    assert use.wire_kg == pytest.approx(0.888, abs=1e-3) and use.gas_l == pytest.approx(15.0)
    assert use.energy_kwh == pytest.approx(2.0) and use.machine_h == pytest.approx(0.5)
    (tmp_path / 'plan.npz').write_bytes(b'torn')
    assert np.isnan(use_of(job(folder=tmp_path, run=run, asked=asked)).gas_l)
    assert np.isnan(use_of(job(folder=tmp_path, run=run, asked={})).wire_kg)


def height(layer: int, text: str) -> dict:
    return {'severity': 'WARNING', 'class': 'height', 'text': text, 'layer': layer, 'position': [0.03, 0.015, 0.0],
            'reaction': 'more than the next layer can correct', 'time': 0.0}  # fmt: skip


def test_a_height_that_was_made_good_is_no_warning_any_more():
    one = job(run={'anomalies': [height(1, '-1.54 mm after layer 1')], 'verdict': 'in tolerance'})
    last = replace(one.scans[1], layer=2)
    one = replace(one, scans=[one.scans[0], last])
    row = re.search(r'<tbody>(.*)</tbody>', anomalies_section(one)).group(1)
    assert '<td class=t>info</td>' in row and '+0.00 mm from what was aimed at' in row
    dent(one, 15, 30, -0.5e-3)
    row = re.search(r'<tbody>(.*)</tbody>', anomalies_section(one)).group(1)
    assert '<td class=t>warning</td>' in row and '-0.50 mm from what was aimed at' in row


@pytest.mark.parametrize(
    'verdict, severity', [('cleans up', 'info'), ('does not clean up', 'warning')]
)
def test_of_a_machined_part_it_is_what_is_left_to_machine(verdict, severity):
    one = job(
        run={
            'anomalies': [height(1, '-1.54 mm after layer 1')],
            'verdict': verdict,
            'stock': {'share': 1.0},
        }
    )
    one.scans[1].maps.update(z=flat(2.7e-3), needed=np.ones((ROWS, COLS)))
    row = re.search(r'<tbody>(.*)</tbody>', anomalies_section(one)).group(1)
    assert f'<td class=t>{severity}</td>' in row and '+0.70 mm left to machine there' in row


def test_times_are_local_and_name_their_zone(monkeypatch):
    monkeypatch.setenv('TZ', 'CET-1')
    time.tzset()
    try:
        assert local_time('2026-11-21T09:30:00Z') == '2026-11-21 10:30 CET (UTC+0100)'
        assert local_time('2026-11-21T09:30:00') == '2026-11-21 09:30 (zone not told)'
        assert local_time('yesterday') == 'yesterday'
    finally:
        monkeypatch.undo()
        time.tzset()


def test_the_first_page_has_pictures_and_a_place_to_sign(tmp_path):
    one = job(folder=tmp_path)
    dent(one, 15, 30, -0.5e-3)
    page = owner_page(one, worst_places(one))
    assert 'before' not in page.split('<img')[0] and page.count('<img') == 1
    assert '0.50 mm too low' in page and 'accepted by' in page and 'signature' in page
    assert 'eq 2.4' not in page and 'cost J' not in page
    assert 'No picture of the part' in owner_page(replace(one, scans=one.scans[1:]), [])


CHROMIUM = shutil.which('chromium') or shutil.which('google-chrome')
CHECKS = Path(__file__).parents[2] / 'waam_panel' / 'test' / 'page_checks.js'


@pytest.mark.skipif(not CHROMIUM, reason='chromium is not installed (apt-get)')
def test_the_first_page_is_one_sheet_of_a4_and_nothing_is_cut_on_a_screen(tmp_path):
    sync = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')
    folder = tmp_path / 'one'
    write_job(folder, layers=1)
    (tmp_path / 'prices.yaml').write_text(
        'currency: EUR\nwire_per_kg: 3\nmachine_per_hour: 36\nnew_part: 5'
    )
    address, found = write_report(folder).as_uri(), []
    with sync.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=['--no-sandbox'])
        page = browser.new_page(
            viewport={'width': 703, 'height': 1032}
        )  # A4 within margins of 12 mm, at 96 px an inch
        page.emulate_media(media='print', color_scheme='dark')
        page.goto(address)
        high = page.evaluate("document.querySelector('.owner').getBoundingClientRect().height")
        wide = page.evaluate('document.documentElement.scrollWidth')
        white = page.evaluate('getComputedStyle(document.body).backgroundColor')
        for theme in ('light', 'dark'):
            for width in (1366, 1024, 390):
                page.emulate_media(media='screen', color_scheme=theme)
                page.set_viewport_size({'width': width, 'height': 800})
                found += [f'{theme} {width}: {v}' for v in page.evaluate(CHECKS.read_text())]
        browser.close()
    assert high <= 1032 and wide <= 703 and white == 'rgb(255, 255, 255)'
    assert not found, '\n'.join(found)


def test_a_shaft_is_shown_round_and_its_maps_are_named_unrolled():
    from waam_process.unrolled import OVERLAP, Unrolled
    from waam_view import figures
    from waam_view.shaft_section import shaft_section

    shaft = Unrolled(0.04)
    cols = round(shaft.length_x / 2e-3)
    z = np.full((15, cols), shaft.level)
    maps = {'z': z - 1e-3, 'nominal': z, 'target': z, 'region': np.ones_like(z)}
    scans = [
        Scan(k, (0.0, 0.0), 2e-3, maps | {'z': z - h}, unrolled=True)
        for k, h in enumerate((1e-3, 1e-4))
    ]
    told = {'goal': {'plan_settings': ['shaft_ends=0.01', 'shaft_diameter=0.04']}}
    run = {'shaft': {'clean_diameter_mm': 39.81, 'roundness_mm': 0.5, 'seam_step_mm': None}}
    turned = Job(Path('.'), 'closed_loop', {}, run, scans=scans, asked=told)
    assert turned.shaft == shaft and job().shaft is None and shaft_section(job()) == ''
    page = shaft_section(turned)
    assert '39.81 mm' in page and 'unrolled' in page and '<img' in page
    assert part_picture.before_and_after(scans[0], scans[1], shaft).startswith(b'\x89PNG')
    assert 'around the shaft' in figures._names(scans[0])[0] and OVERLAP == 0.02
    assert (
        Job(
            Path('.'),
            'closed_loop',
            {},
            {},
            asked={'goal': {'plan_settings': ['shaft_diameter=x']}},
        ).shaft
        is None
    )
