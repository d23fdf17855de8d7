"""The report says what report.json says, needs nothing else, and survives what is missing."""

import base64
import dataclasses
import json
import re
import shutil
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from synthetic_job import write_demo, write_job  # noqa: E402

from waam_view import canvas, figures, part_picture  # noqa: E402
from waam_view.html import STYLE, escape  # noqa: E402
from waam_view.job_data import JobError, load_job, read_report  # noqa: E402
from waam_view.outcome import outcome  # noqa: E402
from waam_view.owner_page import verdict_box  # noqa: E402
from waam_view.report import main, write_all, write_report  # noqa: E402

SECTIONS = [
    'What it took', 'Surface', 'Beads', 'Layers', 'Arc and heat', 'Corrections', 'Limits, drop-outs and faults',
    'Anomalies', 'Provenance',
]  # fmt: skip


@pytest.fixture(autouse=True, scope='module')
def coarse_pictures():
    fine, canvas.DPI = canvas.DPI, 40
    cells, part_picture.CELLS = part_picture.CELLS, 12
    yield
    canvas.DPI, part_picture.CELLS = fine, cells


@pytest.fixture(scope='module')
def job(tmp_path_factory):
    folder = tmp_path_factory.mktemp('jobs') / 'one'
    report = write_job(folder, layers=2)
    return folder, report, write_report(folder).read_text()


def pictures(text):
    found = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    return [base64.b64decode(p) for p in found]


def test_numbers_of_the_report_appear(job):
    _, report, text = job
    run = report['closed_loop']
    for value in (
        f'{run["rms_mm"]:.3f} mm',
        f'{run["max_mm"]:.3f} mm',
        '37.42 m',
        '2.44 kg/h',
        '0.508 kWh',
    ):
        assert value in text
    assert '13 min 32 s' in text and '7 min 31 s' in text and '87.3 %' in text
    for count in (48213, 12, 37, 211):
        assert f'<td>{count}</td>' in text
    for layer in run['layers']:
        assert f'{layer["height_error_rms"] * 1e3:.3f}' in text
    assert '0123abcd' in text and 'packages.numpy' in text


def page_of(folder: Path, report: dict, run: dict, **other) -> str:
    """The page of a job of which only report.json is there, with changes of its run and of the rest."""
    whole = {**report, **other, 'closed_loop': {**report['closed_loop'], **run}}
    (folder / 'report.json').write_text(json.dumps(whole))
    return write_report(folder).read_text()


def section_of(page: str, title: str) -> str:
    return page.split(f'<h2>{title}</h2>')[1].split('<h2>')[0]


def test_passes_and_resumes_are_told(job, tmp_path):
    _, report, text = job
    assert '<h2>Passes</h2>' not in text and 'resumed' not in text
    first = {'pass_number': 1, 'layers': 3, 'set_height': 5.75e-3}
    passes = [
        {**first, 'measured_rms': 0.4321e-3, 'measured_mean': -0.25e-3},
        {**first, 'pass_number': 2, 'corrected_height': 6.123e-3, 'measured_rms': None},
    ]
    section = section_of(page_of(tmp_path, report, {'passes': passes, 'runs': 3}), 'Passes')
    for value in ('5.750', '6.123', '0.432', '-0.250', 'resumed 2 times'):
        assert value in section.replace('\u2212', '-')
    assert 'top-ups' not in section
    passes[1]['set_height'] = None
    machined = {'passes': passes, 'stock': {'share': 0.999}}
    assert 'are top-ups' in section_of(page_of(tmp_path, report, machined), 'Passes')


def test_a_forecast_stands_beside_the_outcome(job, tmp_path):
    _, report, text = job
    assert 'Forecast and outcome' not in text
    rms = report['closed_loop']['rms_mm']
    told = {
        'verdict': 'will be in tolerance: 12 of 12 cells', 'cells': 12, 'preset': 'recorded', 'band': 0.9,
        'figures': {
            'rms_mm': {'value': 1.1 * rms, 'low': 0.8 * rms, 'high': 1.3 * rms},
            'wire_m': {'value': 20.0, 'low': 19.0, 'high': 21.0},
            'stock_mean_mm': {'value': 0.5, 'low': 0.4, 'high': 0.6},
        },
    }  # fmt: skip
    section = section_of(page_of(tmp_path, report, {'forecast': told}), 'Forecast and outcome')
    rows = [re.findall('<td[^>]*>(.*?)</td>', row) for row in section.split('<tr')]
    shown = {row[0].split(',')[0]: row[1:] for row in rows if row}
    assert shown['RMS height error'][2:] == [f'{rms:.3f}', 'yes']
    assert shown['wire'] == ['20.00', '19.00 … 21.00', '37.42', 'no']
    assert shown['stock to machine'][-1] == ''  # it was not machined: there is no outcome
    assert 'will be in tolerance: 12 of 12 cells; 12 cells, preset recorded' in section


def test_how_it_was_laid_is_told_in_words(job, tmp_path):
    _, report, _ = job
    layers = [dict(x) for x in report['closed_loop']['layers'] if not x.get('final')]
    for x in layers:
        x |= {'law': 'unet', 'correction_applied': True, 'fallback': False}
    layers[0] |= {'fallback': True, 'expected_rms': 1.0}
    layers[0] |= {'expected_rms_low': 1e-6, 'expected_rms_high': 2.0}
    layers[1] |= {'bead_width': 6.41e-3, 'bead_width_u': 0.07e-3, 'width_ratio': 1.05}
    passes = [{'pass_number': 1, 'schedule': '3 finishing layers of <1.00> mm'}]
    learned = {'jobs': 2, 'sha256': 'fedcba9876543210', 'sha256_after': 'abcdef0123456789'}
    trace = {'models': {'0123456789abcdef': [1]}, 'learned': learned}
    changed = {'layers': layers, 'passes': passes}
    page = page_of(tmp_path, report, changed, trace=trace)
    section, count = section_of(page, 'How it was laid'), len(layers)
    for words in (
        'Layer schedule: 3 finishing layers of &lt;1.00&gt; mm.',
        f'{count} of {count} layers: 1 by fallback, {count - 1} by unet', 'weights 0123456789ab.',
        'in its 90 % interval after 1 of 1 layers', 'former jobs of this cell: 2 jobs (fedcba987654).',
        'Kept for the next one: abcdef012345.', f'{layers[-1]["flow_factor"]:.3f} at the last',
        'from the network how layers differ', 'Bead width: 6.41 mm where beads stood free',
        'held by the voltage in 1 layer.',
    ):  # fmt: skip
        assert words in section, words
    tables = section_of(page, 'Layers')
    assert '1000.00 (0.00 to 2000.00)' in tables and 'by width' in tables and 'bead width' in tables
    # a report of several runs tells it per run
    assert 'weights 0123456789ab.' in page_of(tmp_path, report, {**changed, 'trace': trace})


def test_traceability_names_what_is_known_and_what_nobody_told(job, tmp_path):
    _, report, page = job
    trace = {
        'operator': '', 'wire_lot': 'L<4711>', 'calibration': {'sha256': 'abcd', 'age_days': 3.5},
        'models': {'f00d': [1, 2]}, 'not_told': ['operator', 'gas'], 'remarks': ['no calibration file'],
    }  # fmt: skip
    about = {'file': 'tolerance_map.csv', 'cell_mm': 0.5, 'cells': 100}
    about |= {'in_tolerance': 90, 'above': 7, 'below': 2, 'unseen': 1}
    text = page_of(tmp_path, report, {'tolerance_map': about}, trace=trace)
    for words in (
        'L&lt;4711&gt;', 'abcd', '3.5', 'models.f00d', '[1, 2]', 'Nobody told:</b> operator, gas',
        'no calibration file', 'tolerance_map.csv', '90 are within', '7 above, 2 below, 1 not seen',
    ):  # fmt: skip
        assert words in section_of(text, 'Traceability'), words
    assert '<h2>Traceability</h2>' not in page


def test_all_sections_and_pictures(job):
    _, _, text = job
    for title in SECTIONS:
        assert f'<h2>{title}</h2>' in text
    found = pictures(text)
    assert len(found) == 8
    assert all(p.startswith(b'\x89PNG') and len(p) > 1000 for p in found)


def test_one_file_without_outside_links_or_scripts(job):
    _, _, text = job
    assert not re.search(r'https?://|<script|<link|src="(?!data:)', text)
    assert len(text) < 3_000_000


def test_text_from_outside_is_escaped(job):
    _, _, text = job
    assert 'arc lost &lt;b&gt;twice&lt;/b&gt;' in text and '<b>twice' not in text
    assert 'A &amp; B &lt;x&gt;' in text


@pytest.mark.parametrize(
    'options, words',
    [
        ({'layer_error': 0.2}, ['ok">IN TOLERANCE']),
        ({'layer_error': 1.0}, ['warn">OUT OF TOLERANCE']),
        ({'failed': True}, ['bad">FAILED', 'error 108', 'arc did not strike after 3 tries']),
    ],
)
def test_the_verdict_has_colour_and_words(tmp_path, options, words):
    report = write_job(tmp_path / 'job', layers=1, **options)
    box = verdict_box(load_job(tmp_path / 'job', report, 'closed_loop'))
    assert all(w in box for w in words)


@pytest.mark.parametrize('missing', ['layers', 'all'])
def test_missing_parts_leave_the_rest(tmp_path, missing):
    folder = tmp_path / 'job'
    write_job(folder, layers=1)
    for name in ('layers', 'telemetry.npz', 'job.yaml') if missing == 'all' else (missing,):
        path = folder / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    text = write_report(folder).read_text()
    assert all(f'<h2>{s}</h2>' in text for s in SECTIONS)
    assert 'RMS height error from nominal, final' in text


def test_bare_failure_without_any_number(tmp_path):
    run = {'verdict': 'failed', 'error_code': 103, 'message': 'mesh is open', 'folder': '.'}
    report = {'job_id': 'x', 'verdict': 'failed', 'closed_loop': run}
    (tmp_path / 'report.json').write_text(json.dumps(report))
    text = write_report(tmp_path).read_text()
    assert 'mesh is open' in text and 'No scan was stored' in text


def test_damaged_scan_is_said_and_left_out(tmp_path):
    folder = tmp_path / 'job'
    write_job(folder, layers=2)
    (folder / 'layers/scan_001.npz').write_bytes(b'PK not a zip')
    text = write_report(folder).read_text()
    assert 'scan_001.npz cannot be read' in text and 'after layer 2' not in text.split('<h2>')[0]


def test_unseen_final_surface(tmp_path):
    """A last scan without one known height must not break the page."""
    folder = tmp_path / 'job'
    write_job(folder, layers=1)
    file = folder / 'layers/scan_001.npz'
    with np.load(file) as f:
        data = dict(f)
    data['z'][:] = np.nan
    np.savez_compressed(file, **data)
    assert '<h2>Surface</h2>' in write_report(folder).read_text()


def test_maps_are_read_in_metres_with_their_region(tmp_path):
    write_job(tmp_path / 'job', layers=2)
    loaded = load_job(tmp_path / 'job', read_report(tmp_path / 'job'), 'closed_loop')
    last = loaded.scans[-1]
    error = last.final_error[last.interior]
    rms = np.sqrt(np.nanmean(error**2)) * 1e3
    assert rms == pytest.approx(loaded.run['rms_mm'], rel=0.2)
    assert np.isnan(last.final_error[~last.region]).all()
    assert last.extent_mm == pytest.approx((10, 80, 20, 60))


@pytest.fixture(scope='module')
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp('demo') / 'demo'
    whole = write_demo(folder)
    written = write_all(folder)
    assert [p.parent.name for p in written] == ['closed_loop', 'open_loop', 'demo']
    return folder, whole, written[-1].read_text()


def test_demo_compares_both_runs(demo):
    _, whole, text = demo
    for loop_mode in ('open_loop', 'closed_loop'):
        assert f'{whole[loop_mode]["rms_mm"]:.3f} mm' in text
        assert f'href="{loop_mode}/report.html"' in text
        for layer in whole[loop_mode]['layers']:
            assert f'{layer["height_error_rms"] * 1e3:.3f}' in text
    assert f'{whole["ratio"]:.3f}' in text
    assert len(pictures(text)) == 4


@pytest.mark.parametrize(
    'changed, words',
    [
        ({'verdict': 'out of tolerance'}, ('OUT OF TOLERANCE: only 89.3% ', 'RMS 0.129 mm', 'Nothing has failed')),
        ({'verdict': 'in tolerance'}, ('The part is in tolerance: 89.3% ',)),
        ({'verdict': 'not judged: nothing was seen'}, ()),
        ({'verdict': 'out of tolerance', 'error_code': 21}, ()),
    ],
)  # fmt: skip
def test_a_demo_says_in_words_what_came_out_on_which_cell(demo, tmp_path, changed, words):
    run = {'rms_mm': 0.1292, 'share_in_tolerance': 0.8933, 'error_code': 0, **changed}
    whole = {**demo[1], 'preset': 'recorded', 'closed_loop': demo[1]['closed_loop'] | run}
    said = outcome(whole)
    shown = page_of(tmp_path, whole, {}).replace('<code>', '`').replace('</code>', '`')
    assert bool(said) == bool(words) and escape(said) in shown
    assert ('<code>waam demo' in page_of(tmp_path, whole, {})) == ('`waam demo' in said)
    assert all(w in said for w in words)
    assert ("'recorded' (beads, arc and scans scatter" in said) == bool(words)
    assert ('--preset gentle' in said) == (changed['verdict'] == 'out of tolerance' and bool(words))
    assert '--preset gentle' not in outcome(whole | {'preset': 'gentle'})
    assert outcome(whole | {'preset': ''}) == ''  # no simulated cell


def test_a_demo_on_a_robot_shows_the_gantry_beside_it(demo, tmp_path):
    source, whole, page = demo
    assert 'Robot and gantry' not in page
    folder = shutil.copytree(source, tmp_path / 'demo')
    gantry = {**whole['open_loop'], 'rms_mm': 0.4567}
    added = {'gantry': gantry, 'machine': 'robot', 'preset': 'rough<'}
    text = page_of(folder, whole, {}, **added)
    assert 'machine: <b>robot</b>' in text and 'simulated cell: <b>rough&lt;</b>' in text
    section = section_of(text, 'Robot and gantry')
    assert 'robot</th>' in section and 'gantry</th>' in section
    assert f'{whole["closed_loop"]["rms_mm"]:.3f}' in section and '0.457' in section
    assert 'href="open_loop/report.html"' in section and len(pictures(section)) == 1
    alone = {k: v for k, v in whole.items() if k != 'open_loop'}
    assert '<h2>Robot and gantry</h2>' in page_of(folder, alone, {}, **added)


def test_a_demo_links_the_part_that_is_machined_afterwards(demo, tmp_path):
    source, whole, page = demo
    assert 'machined afterwards' not in page
    run = {**whole['closed_loop'], 'verdict': 'cleans up', 'message': 'cleans up: 99.9% <b>'}
    second = run | {'part': 'die_nominal.stl', 'folder': 'a_machined'}
    folder = shutil.copytree(source, tmp_path / 'demo')
    section = section_of(
        page_of(folder, whole, {}, second=second), 'A part that is machined afterwards'
    )
    assert 'die_nominal.stl' in section and 'cleans up: 99.9% &lt;b&gt;' in section
    assert 'href="a_machined/report.html"' in section


def test_print_rules_are_for_what_the_pages_hold(job, demo):
    """Every class and tag that the print block names occurs in a page, and what breaks badly has a rule."""
    text = job[2] + demo[2]
    rules = STYLE[STYLE.index('@media print{') + len('@media print{') :]
    rules = re.sub(r'@page\{[^}]*\}', '', rules)
    selectors = [s.strip() for r in re.findall(r'([^{}]+)\{[^{}]*\}', rules) for s in r.split(',')]
    used = {c for found in re.findall(r'class="?([\w ]+)', text) for c in found.split()}
    for selector in selectors:
        assert set(re.findall(r'\.(\w+)', selector)) <= used, selector
        for tag in re.findall(r'(?<![.\w])[a-z]\w*', selector.split(':')[0]):
            assert f'<{tag}' in text, selector
    for rule in (
        '@page{size:A4', 'body{background:#fff', ',tr{break-inside:avoid}', 'h2,h3{break-after:avoid}',
        '.owner{break-after:page}',
        'thead{display:table-header-group}', '.scroll{overflow:visible}', 'img{max-height:',
    ):  # fmt: skip
        assert rule in STYLE[STYLE.index('@media print{') :]
    assert 'figure{margin:8px 0;break-inside:avoid}' in STYLE


def test_maps_of_many_layers_fit_on_pages(tmp_path):
    write_job(tmp_path / 'job', layers=1)
    loaded = load_job(tmp_path / 'job', read_report(tmp_path / 'job'), 'closed_loop')
    for turned in (False, True):
        scans = [turn(loaded.scans[0]) if turned else loaded.scans[0]] * 20
        maps = [s.error * 1e3 for s in scans]
        found = figures.grids(scans, maps, 0.5, 'mm', [str(k) for k in range(20)])
        assert len(found) > 1
        for png in found:
            width, height = struct.unpack('>II', png[16:24])
            assert height / width <= 240 / 186 * 1.02  # of the print rules: A4 without margins


def turn(scan):
    """The same part lying the other way."""
    x, y = scan.origin
    maps = {k: v.T for k, v in scan.maps.items()}
    return dataclasses.replace(scan, origin=(y, x), maps=maps)


def test_several_writers_at_once_never_show_half_a_page(tmp_path):
    """The client of a job and the dashboard write the same page when the job has ended."""
    folder = tmp_path / 'job'
    write_job(folder, layers=1)
    command = [sys.executable, '-m', 'waam_view.report', str(folder)]
    writers = [subprocess.Popen(command, stdout=subprocess.DEVNULL) for _ in range(2)]
    seen = set()
    while any(w.poll() is None for w in writers):
        if (folder / 'report.html').exists():
            seen.add((folder / 'report.html').read_text())
        time.sleep(0.01)
    assert [w.returncode for w in writers] == [0, 0]
    seen.add((folder / 'report.html').read_text())
    assert len(seen) == 1 and seen.pop().endswith('</html>\n')
    assert sorted(p.name for p in folder.glob('*report*')) == ['report.html', 'report.json']


def test_report_as_a_program_says_what_is_wrong(tmp_path, capsys):
    assert main([str(tmp_path)]) == 1
    assert 'report.json is not there' in capsys.readouterr().err


@pytest.mark.parametrize('content', [None, 'nonsense', '[]', '{"job_id": "x"}'])
def test_a_folder_that_is_no_job_is_refused(tmp_path, content):
    if content is not None:
        (tmp_path / 'report.json').write_text(content)
    with pytest.raises(JobError, match=r'report\.json'):
        write_report(tmp_path)
    assert not (tmp_path / 'report.html').exists()
