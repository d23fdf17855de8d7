"""waam jobs: every verb answers in words and in JSON; mistakes of use are one line that names what and where."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import pytest

from waam_archive import cli

sys.path.insert(0, str(Path(__file__).parent))
from made_jobs import make_job  # noqa: E402


@pytest.fixture(scope='module')
def jobs(tmp_path_factory):
    """Twelve jobs; the last ones come out worse."""
    folder = tmp_path_factory.mktemp('cli') / 'jobs'
    for n in range(1, 13):
        bad = n > 9
        make_job(
            folder, n, rms=(1.0 + 0.01 * (n % 3) + bad) * 1e-4, wire_lot='B' if bad else 'A', arrays=n in (1, 12),
            verdict='out of tolerance' if bad else 'in tolerance', layers=1,
        )  # fmt: skip
    return folder


@pytest.fixture
def waam(jobs, capsys):
    """Runs a command line; gives status, output and complaints."""
    return runner(jobs, capsys)


def runner(jobs, capsys):
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers(), lambda: jobs)

    def run(*words):
        args = parser.parse_args(['jobs', *map(str, words)])
        status = args.run_command(args)
        said = capsys.readouterr()
        return status, said.out, said.err

    return run


def test_asking_takes_new_jobs_in_first(waam, jobs):
    status, out, _ = waam('list', '--limit', '3')
    assert status == 0 and out.count('roller') == 6  # id and part of three
    assert (jobs / 'archive/archive.json').is_file()


VERBS = [
    ['list'], ['show', 'roller_12'], ['compare', 'roller_1', 'roller_12'], ['find', 'twice'], ['trend', 'rms'],
    ['trend', 'rms', '--subgroup', '3', '--upper', '0.3'], ['figures'], ['figures', '--by', 'wire_lot'],
    ['trace', 'roller.stl'], ['sql', 'SELECT count(*) AS n FROM jobs'], ['ingest'], ['verify'],
    ['compare', '--wire-lot', 'B'],
    ['trace', 'ROLLER'],
]  # fmt: skip


@pytest.mark.parametrize('words', VERBS, ids=' '.join)
def test_every_verb_prints_words_and_json(waam, words):
    if 'roller_1' in words:  # a part of other ids, too
        words = ['20260105T090000Z' if w == 'roller_1' else w for w in words]
    status, out, _ = waam(*words)
    assert status == 0 and out.strip()
    status, out, err = waam(*words, '--json')
    assert status == 0 and json.loads(out) is not None and not err


def test_a_trend_names_the_shift_and_draws_it(waam, tmp_path):
    _, out, _ = waam('trend', 'rms', '--baseline', '9', '--picture', tmp_path / 'rms.png')
    assert (
        'nelson 1' in out
        and 'outlier' in out
        and (tmp_path / 'rms.png').read_bytes()[:4] == b'\x89PNG'
    )
    _, out, _ = waam('trend', 'rms', '--baseline', '9', '--wire-lot', 'A')
    assert 'no rule is broken' in out and '9 points are few' in out


def test_a_word_is_found_in_what_a_report_says_and_not_in_the_names_of_its_entries(waam):
    assert 'no job has' in waam('find', 'arc_on_s')[1]  # an entry of every report
    _, out, _ = waam('find', 'block 3')  # the artefact of the calibration
    assert out.count('report') == 12 and 'block 3' in out


def test_figures_with_prices(waam, tmp_path):
    (tmp_path / 'prices.yaml').write_text('wire_per_kg: 5\nmachine_per_hour: 60\n')
    _, out, _ = waam('figures', '--by', 'wire_lot', '--prices', tmp_path / 'prices.yaml', '--json')
    found = json.loads(out)
    assert found['A']['jobs'] == 9 and found['B']['defect_share_of_jobs'] == 1.0
    assert found['A']['cost_machine'] == pytest.approx(9 * 10)


def test_a_page_of_a_part(waam, tmp_path):
    waam('trace', 'roller.stl', '-o', tmp_path / 'x.html')
    assert 'block 3' in (tmp_path / 'x.html').read_text()


def test_export_delete_and_come_back(waam, jobs, tmp_path):
    assert waam('export', '-o', tmp_path / 'out', '--format', 'csv', '--wire-lot', 'B')[0] == 0
    assert len((tmp_path / 'out/jobs.csv').read_text().splitlines()) == 4
    with pytest.raises(ValueError, match='nothing was deleted'):
        waam('delete', 'roller_5')
    assert waam('delete', 'roller_5', '--yes')[0] == 0
    assert len(json.loads(waam('list', '--json')[1])) == 11
    assert '1 added' in waam('ingest', next(jobs.glob('*roller_5')))[1]


def test_jobs_are_deleted_by_filters_and_never_without_a_word(tmp_path, capsys):
    waam = runner(tmp_path, capsys)
    for n in range(1, 5):
        make_job(tmp_path, n, layers=1, arrays=False, wire_lot='A' if n < 3 else 'B')
    with pytest.raises(ValueError, match='which jobs'):
        waam('delete', '--yes')
    with pytest.raises(ValueError, match='no job fits'):
        waam('delete', '--yes', '--wire-lot', 'C')
    with pytest.raises(ValueError, match='nothing was deleted'):
        waam('delete', '--wire-lot', 'A')
    assert len(json.loads(waam('delete', '--wire-lot', 'A', '--yes', '--json')[1])['deleted']) == 2
    assert {r['wire_lot'] for r in json.loads(waam('list', '--json')[1])} == {'B'}


@pytest.mark.parametrize(
    'words,said',
    [
        (['show', 'nothing'], 'no job'), (['show', 'roller'], '12 jobs'), (['list', '--since', 'soon'], 'is no time'),
        (['list', '--limit', '-1'], '--limit -1'), (['trend', 'rms', '--subgroup', '11'], '1 to 10'),
        (['figures', '--prices', 'nowhere.yaml'], 'nowhere.yaml'), (['trace', 'x.stl'], 'x.stl'),
        (['sql', 'DROP TABLE jobs'], 'one SELECT'), (['ingest', 'nowhere'], 'nowhere'),
        (['trend', 'rms', '--baseline', '1'], 'two or more'),
        (['verify', '--archive', '/nowhere'], '/nowhere'),
        (['list', '--archive', '/nowhere', '--no-ingest'], '/nowhere'), (['export', '-o', '/'], 'exists'),
    ],
    ids=lambda v: ' '.join(v) if isinstance(v, list) else '',
)  # fmt: skip
def test_mistakes_of_use_name_what_and_where(waam, words, said):
    with pytest.raises((ValueError, OSError), match=said):
        waam(*words)


def test_ingest_says_what_it_refuses(waam, tmp_path):
    bad = make_job(tmp_path / 'other', arrays=False)
    (bad / 'report.json').write_text('{')
    status, out, err = waam('ingest', bad, '--archive', tmp_path / 'a')
    assert status == 1 and '0 added' in out and f'{bad}/report.json' in err
