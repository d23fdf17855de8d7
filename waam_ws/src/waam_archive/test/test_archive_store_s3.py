"""An archive on a store: a real S3 server on this machine (moto; skipped where it is not installed), and a folder that
only copies may touch, which always runs."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import pyarrow.dataset as ds
import pyarrow.fs
import pyarrow.parquet as pq
import pytest

from waam_archive import cli
from waam_archive.remote import Remote

sys.path.insert(0, str(Path(__file__).parent))
from made_jobs import make_job  # noqa: E402


@pytest.fixture(scope='module')
def s3():
    """Address of a bucket."""
    server = pytest.importorskip('moto.server', reason='moto is not installed')
    running = server.ThreadedMotoServer(ip_address='127.0.0.1', port=0, verbose=False)
    running.start()
    _, port = running.get_host_and_port()
    patch = pytest.MonkeyPatch()
    for name in ('AWS_ACCESS_KEY_ID', 'AWS_SECRET_ACCESS_KEY'):
        patch.setenv(name, 'of-the-test')
    where = {'endpoint_override': f'127.0.0.1:{port}', 'scheme': 'http', 'region': 'us-east-1'}
    pyarrow.fs.S3FileSystem(**where, allow_bucket_creation=True).create_dir('shop')
    yield 's3://shop/{}?' + '&'.join(f'{k}={v}' for k, v in where.items())
    running.stop()
    patch.undo()


@pytest.fixture(params=['s3', 'folder'])
def address(request, tmp_path):
    """address('archive'): a place on the store."""
    if request.param == 'folder':
        return lambda name: f'file://{tmp_path}/store/{name}'
    place = request.getfixturevalue('s3')
    return lambda name: place.format(f'{tmp_path.name}/{name}')


@pytest.fixture
def waam(tmp_path, capsys):
    """waam('one', ...): a command line of a computer whose folder of jobs is tmp_path/one."""

    def run(computer, *words):
        parser = argparse.ArgumentParser()
        cli.register(parser.add_subparsers(), lambda: tmp_path / computer)
        args = parser.parse_args(['jobs', *map(str, words), '--json'])
        assert args.run_command(args) == 0
        return json.loads(capsys.readouterr().out)

    return run


def test_one_computer_takes_jobs_in_and_another_asks(address, waam, tmp_path):
    at = address('archive')
    for n in range(1, 4):
        make_job(tmp_path / 'one', n, layers=1, rms=n * 1e-4)
    assert len(waam('one', 'ingest', '--archive', at)['added']) == 3
    assert len(waam('one', 'ingest', '--archive', at)['unchanged']) == 3
    listed = [r['rms_mm'] for r in waam('two', 'list', '--archive', at)]
    assert listed == pytest.approx([0.3, 0.2, 0.1])
    charted = [r['value'] for r in waam('two', 'trend', 'rms', '--archive', at)['jobs']]
    assert charted == pytest.approx([0.1, 0.2, 0.3])
    assert waam('two', 'sql', 'SELECT count(*) AS n FROM telemetry', '--archive', at)[0]['n'] > 0

    make_job(tmp_path / 'two', 9, layers=1, rms=9e-4)
    assert len(waam('two', 'ingest', '--archive', at)['added']) == 1
    gone = waam('one', 'delete', 'roller_1', '--yes', '--archive', at)['deleted']
    assert len(gone) == 1
    left = [r['rms_mm'] for r in waam('three', 'list', '--archive', at)]
    assert left == pytest.approx([0.9, 0.3, 0.2])


def test_a_policy_belongs_to_the_store_and_every_byte_there_is_checked(address, waam, tmp_path):
    at = address('archive')
    make_job(tmp_path / 'one', 1, layers=1)
    waam('one', 'ingest', '--archive', at)
    waam('one', 'policy', '--older-than', '30d', '--archive', at)
    assert waam('two', 'policy', '--archive', at)['older_than'] == '30d'
    assert waam('two', 'verify', '--archive', at)['files'] > 2
    make_job(tmp_path / 'two', 2, layers=1)
    waam(
        'two', 'ingest', '--archive', at
    )  # both jobs are of January: the policy takes their arrays
    assert waam('one', 'sql', 'SELECT count(*) AS n FROM maps', '--archive', at)[0]['n'] == 0
    waam('two', 'policy', '--clear', '--archive', at)
    assert waam('one', 'policy', '--archive', at)['older_than'] == ''

    files, root = pyarrow.fs.FileSystem.from_uri(at)
    found = files.get_file_info(pyarrow.fs.FileSelector(root, recursive=True))
    beads = next(f.path for f in found if f.path.endswith('beads.parquet'))
    with files.open_output_stream(beads) as out:
        out.write(b'x')
    with pytest.raises(AssertionError):  # exit status 1
        waam('one', 'verify', '--archive', at)


def test_what_is_exported_is_read_by_other_programs(address, waam, tmp_path):
    make_job(tmp_path / 'one', 1, layers=1)
    to = address('export')
    assert waam('one', 'export', '-o', to)['rows']['jobs'] == 1
    files, root = pyarrow.fs.FileSystem.from_uri(to)
    beads = pq.read_table(f'{root}/beads.parquet', filesystem=files)
    assert beads.num_rows > 0
    import duckdb

    jobs = ds.dataset(f'{root}/jobs.parquet', filesystem=files)
    ((part, rms),) = duckdb.sql('SELECT part, rms_mm FROM jobs').fetchall()
    assert (part, rms) == ('roller.stl', pytest.approx(0.1))
    assert jobs.count_rows() == 1
    with pytest.raises(ValueError, match='exists; nothing was written') as e:
        waam('one', 'export', '-o', to)
    assert '?' not in str(e.value)


def test_a_copy_that_was_broken_off_shows_no_half_of_a_job(waam, tmp_path, monkeypatch):
    """Markers come last: whatever number of files has arrived, the store has the old jobs or all of them."""
    at = f'file://{tmp_path}/store'
    make_job(tmp_path / 'one', 1, layers=1)
    waam('one', 'ingest', '--archive', at)
    make_job(tmp_path / 'one', 2, layers=1)
    send, left = Remote._send, [0]

    def breaks(self, name, file):
        left[0] -= 1
        if left[0] < 0:
            raise OSError('the line is cut')
        send(self, name, file)

    monkeypatch.setattr(Remote, '_send', breaks)
    seen = set()
    for after in (1, 6, 99):
        left[0] = after
        try:
            waam('one', 'ingest', '--archive', at)
        except ValueError as e:
            assert 'the line is cut' in str(e)
        seen.add(len(waam('two', 'list', '--archive', at)))
        rows = waam('two', 'sql', 'SELECT count(DISTINCT job) AS n FROM maps', '--archive', at)
        assert rows[0]['n'] == len(waam('two', 'list', '--archive', at))
    assert seen == {1, 2}


def test_a_store_that_is_not_there_is_named_without_its_options(waam, tmp_path, monkeypatch):
    monkeypatch.setenv('AWS_EC2_METADATA_DISABLED', 'true')
    with pytest.raises(ValueError, match='file:///') as e:
        waam('one', 'list', '--archive', f'file://{tmp_path}/nothing')
    with pytest.raises(ValueError, match='ftp://store/x') as e:
        waam('one', 'list', '--archive', 'ftp://me:secret@store/x?key=secret')
    assert 'secret' not in str(e.value)
