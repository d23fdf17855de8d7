"""What jobs teach: kept by those that end in order, read by the next one, never lost, never in the way of a job."""

import json

import pytest

from waam_job.model.records import State
from waam_job.store.learned import LearnedFile, file_name
from waam_process.learned import nothing, parse
from waam_process.segment import Kind


@pytest.fixture
def job(make_cell, make_runner, tmp_path):
    """job(**goal fields) -> (cell, folder, status) of one layer that ended."""

    def run(settings=None, abort=False, before=None, **fields):
        cell = make_cell()
        goal = {'layers': 1, 'learned_dir': tmp_path / 'learned', **fields}
        runner, control, folder = make_runner(cell, settings, **goal)
        if abort:
            in_a_bead(cell, lambda: control.abort('enough'))
        return cell, folder, runner.run()

    return run


def in_a_bead(cell, action):
    """`action` once a piece of the first bead has been laid."""
    inner = cell.enqueue

    def enqueue(job_id, segments, last):
        beads = [s.index for s in segments if s.kind == Kind.DEPOSIT]
        cell.script |= {i: lambda _: action() for i in beads[:1]}
        inner(job_id, segments, last)

    cell.enqueue = enqueue


def learned_file(tmp_path, cell='simulated'):
    return LearnedFile.of(tmp_path / 'learned', cell, 'er70s-6', 'w600_h200')


def trace_of(folder):
    return json.loads((folder.path / 'report.json').read_text())['trace']


def test_the_second_job_starts_with_what_the_first_taught(job, tmp_path):
    one, first_folder, status = job(notes=('wire_lot=7',))
    assert status.state == State.DONE
    assert [parse(t).jobs for t in one.told_learned] == [0]
    file = learned_file(tmp_path)
    kept, trouble = file.read()
    assert not trouble and kept.jobs == 1 and kept.last_job == first_folder.job_id
    assert kept.wire_lot == '7' and kept.efficiency == pytest.approx(0.85, abs=5e-3)
    first = trace_of(first_folder)
    assert first['learned']['jobs'] == 0 and first['learned']['sha256_after'] == kept.sha256
    assert any('starts fresh' in r for r in first['remarks'])

    two, folder, _ = job(notes=('wire_lot=8',))
    told = parse(two.told_learned[0])
    assert told == kept.for_job('8')
    assert (folder.path / 'learned.json').read_text() == two.told_learned[0]
    second = trace_of(folder)
    assert second['learned']['sha256'] == kept.sha256 and second['learned']['jobs'] == 1
    said = next(r for r in second['remarks'] if 'what 1 job taught' in r)
    assert 'another lot' in said
    assert file.read()[0].jobs == 2


@pytest.mark.parametrize(
    ('fields', 'told'),
    [
        ({'fresh': True}, False),
        ({'learned_dir': None}, False),
        ({'loop_mode': 'open_loop'}, None),
        ({'loop_mode': 'monitor'}, True),
        ({'settings': {'keep_learned': False}}, True),
        ({'abort': True}, True),
    ],
    ids=['fresh', 'no folder', 'open loop', 'monitor', 'not to be kept', 'aborted'],
)
def test_only_closed_loop_jobs_that_end_in_order_teach(job, tmp_path, fields, told):
    cell, folder, status = job(**fields)
    assert (status.state == State.DONE) != fields.get('abort', False)
    assert not learned_file(tmp_path).path.exists()
    assert [bool(t) for t in cell.told_learned] == ([] if told is None else [told])
    assert 'sha256_after' not in trace_of(folder)['learned']


@pytest.mark.parametrize(
    'text',
    [
        'torn {',
        '',
        nothing('mill', 'er70s-6', 'w600_h200').text(),
        nothing('simulated', 'er70s-6', 'w600_h200').text().replace('0.15', '0.151'),
    ],
    ids=['no JSON', 'empty', 'of another cell', 'changed'],
)
def test_a_bad_file_is_named_kept_and_replaced(job, tmp_path, text):
    file = learned_file(tmp_path)
    file.path.parent.mkdir(parents=True)
    file.path.write_text(text)
    cell, folder, status = job()
    assert status.state == State.DONE
    warning = next(a for a in cell.anomalies if str(file.path) in a.text)
    assert warning.severity == 'WARNING' and 'first job' in warning.reaction
    assert parse(cell.told_learned[0]).jobs == 0
    (aside,) = file.path.parent.glob('*.bad')
    assert aside.read_text() == text and folder.job_id in aside.name
    assert file.read()[0].jobs == 1
    assert any(str(aside) in r for r in trace_of(folder)['remarks'])


def test_a_folder_that_cannot_be_written_ends_no_job(job, tmp_path):
    (tmp_path / 'learned').write_text('a file')
    cell, _, status = job()
    assert status.state == State.DONE
    assert any('could not be kept' in a.text for a in cell.anomalies)


def test_cells_materials_and_regimes_are_apart(job, tmp_path):
    job()
    job(settings={'cell': 'mill 2/../x'})
    job(layer_height=1.5e-3)
    found = sorted(str(p.relative_to(tmp_path / 'learned')) for p in tmp_path.rglob('*_h*.json'))
    assert found == [
        'mill-2-..-x/er70s-6_w600_h200.json',
        'simulated/er70s-6_w600_h150.json',
        'simulated/er70s-6_w600_h200.json',
    ]


@pytest.mark.parametrize('name', ['', '.', '..', '/', 'a/b', '\0', 'x' * 300, 'é'])
def test_names_stay_inside_the_folder(name, tmp_path):
    safe = file_name(name)
    assert (tmp_path / safe).resolve().parent == tmp_path.resolve() and len(safe) <= 80
