"""A file of state on a disk that fills up: it is the old one, or the new one, never half of each."""

from __future__ import annotations

import errno
import json
import os

import pytest

from waam_node import files


@pytest.fixture
def full(monkeypatch):
    """A disk on which no file can be made any more."""
    inner = os.open

    def refuse(path, flags, *rest):
        if flags & os.O_CREAT:
            raise OSError(errno.ENOSPC, 'No space left on device')
        return inner(path, flags, *rest)

    monkeypatch.setattr(files.os, 'open', refuse)


@pytest.mark.parametrize('message', ['short', 'x' * 3000])
def test_how_a_job_ended_is_written_on_a_full_disk(tmp_path, request, message):
    file = tmp_path / 'status.json'
    files.write_state(file, json.dumps({'state': 'DEPOSITING', 'message': 'y' * 500}))
    request.getfixturevalue('full')
    files.write_state(file, json.dumps({'state': 'FAILED', 'message': message}))
    assert json.loads(file.read_text()) == {'state': 'FAILED', 'message': message}
    assert os.listdir(tmp_path) == ['status.json']


def test_what_has_no_room_leaves_the_old_file(tmp_path, request):
    file, old = tmp_path / 'status.json', json.dumps({'state': 'DEPOSITING'})
    files.write_state(file, old)
    request.getfixturevalue('full')
    with pytest.raises(OSError, match='No space left'):
        files.write_state(file, json.dumps({'message': 'x' * 10_000_000}))
    with pytest.raises(OSError, match='No space left'):
        files.write_state(tmp_path / 'new.json', old)
    assert file.read_text() == old


def test_nothing_is_written_through_a_link_that_somebody_put_there(tmp_path, request):
    (tmp_path / 'other').write_text('keep')
    (tmp_path / 'status.json').symlink_to(tmp_path / 'other')
    request.getfixturevalue('full')
    with pytest.raises(OSError, match='No space left'):
        files.write_state(tmp_path / 'status.json', '{}')
    assert (tmp_path / 'other').read_text() == 'keep'


def test_other_errors_are_not_worked_around(tmp_path):
    with pytest.raises(FileNotFoundError):
        files.write_state(tmp_path / 'gone' / 'status.json', '{}')
