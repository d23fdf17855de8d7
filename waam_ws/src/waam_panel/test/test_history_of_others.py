"""Job folders that strangers may have written: the list goes on, and nothing outside of a folder is shown."""

from __future__ import annotations

import json
import os
import threading

import pytest

from waam_panel import history
from waam_panel.parts import PartFolders, PartsError, sha256_of

BAD = {
    'nested': b'[' * 100_000, 'text': b'\xff\xfe\xff', 'empty': b'', 'twice': b'{"a": 1, "a": 2}',
    'huge': b'{"layers": 1' + b'0' * 400 + b'}', 'NaN': b'{"layers": NaN}', 'list': b'[1]',
}  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """Two good jobs around one whose status is to be spoilt."""
    for name, state in (
        ('20260101T000000Z_a', 'DONE'),
        ('20260102T000000Z_bad', 'FAILED'),
        ('20260103T000000Z_c', 'DONE'),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'status.json').write_text(json.dumps({'state': state, 'layers': 2}))
        (tmp_path / name / 'job.yaml').write_text('goal: {}')
    return tmp_path


def listed(folder):
    """The list, or a failure after 20 s."""
    found = []
    thread = threading.Thread(target=lambda: found.extend(history.jobs(folder)), daemon=True)
    thread.start()
    thread.join(20.0)
    assert not thread.is_alive(), 'the list hangs'
    return {row['id']: row for row in found}


@pytest.mark.parametrize('case', BAD)
def test_a_damaged_status_takes_no_other_job_along_and_is_named(case, folder):
    (folder / '20260102T000000Z_bad/status.json').write_bytes(BAD[case])
    rows = listed(folder)
    assert len(rows) == 3 and rows['20260101T000000Z_a']['state'] == 'DONE'
    bad = rows['20260102T000000Z_bad']
    assert bad['state'] == 'UNKNOWN' and 'status.json' in bad['message'] and not bad['can_go_on']
    assert str(folder) not in bad['message'], 'the page needs no path of the server'
    json.dumps(list(rows.values()), allow_nan=False)


@pytest.mark.parametrize('kind', ['fifo', 'link', 'folder', 'device'])
def test_what_is_no_file_is_named_and_nobody_waits_for_it(kind, folder, tmp_path_factory):
    file = folder / '20260102T000000Z_bad/status.json'
    file.unlink()
    if kind == 'fifo':
        os.mkfifo(file)
    elif kind == 'folder':
        file.mkdir()
    else:
        secret = tmp_path_factory.mktemp('secret') / 'status.json'
        secret.write_text('{"state": "DONE", "message": "told to nobody"}')
        file.symlink_to('/dev/zero' if kind == 'device' else secret)
    bad = listed(folder)['20260102T000000Z_bad']
    assert bad['state'] == 'UNKNOWN' and 'status.json' in bad['message']
    assert 'told to nobody' not in json.dumps(bad)


def test_a_report_page_that_is_a_link_is_old_and_made_anew(folder):
    job = folder / '20260101T000000Z_a'
    (job / 'report.json').write_text('{}')
    (folder / 'outside').write_text('told to nobody')
    (job / 'report.html').symlink_to(folder / 'outside')
    assert history.report_is_old(job)


def test_parts_are_files_and_no_links(tmp_path):
    (tmp_path / 'secret').write_text('told to nobody')
    parts = PartFolders((tmp_path / 'parts',))
    parts.save('a.stl', b'1')
    (tmp_path / 'parts/b.stl').symlink_to(tmp_path / 'secret')
    os.mkfifo(tmp_path / 'parts/c.stl')
    assert [row['name'] for row in parts.listing()] == ['a.stl']
    for name in ('b.stl', 'c.stl'):
        with pytest.raises(PartsError):
            parts.find(name)
        with pytest.raises(PartsError):
            sha256_of(tmp_path / 'parts' / name)
        assert parts.save(name, b'2') != name
    assert (tmp_path / 'secret').read_text() == 'told to nobody'


def test_parts_that_the_owner_of_the_cell_offers_may_be_links(tmp_path):
    """colcon installs them so: the demo's parts were missing on the page."""
    (tmp_path / 'source').mkdir()
    (tmp_path / 'source/jaw.stl').write_text('a part')
    (tmp_path / 'given').mkdir()
    (tmp_path / 'given/jaw.stl').symlink_to(tmp_path / 'source/jaw.stl')
    (tmp_path / 'given/gone.stl').symlink_to(tmp_path / 'source/gone.stl')
    os.mkfifo(tmp_path / 'given/pipe.stl')
    parts = PartFolders((tmp_path / 'up', tmp_path / 'given'))
    assert [row['name'] for row in parts.listing()] == ['jaw.stl']
    assert parts.find('jaw.stl') == tmp_path / 'source/jaw.stl'
    assert sha256_of(parts.find('jaw.stl'))
