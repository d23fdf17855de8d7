"""Files that others may have written are read wholly, or refused by name and in time."""

from __future__ import annotations

import io
import json
import os
import threading
import zipfile

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from waam_process.safe_files import (
    FileError,
    Missing,
    is_file,
    opened,
    parse_json,
    parse_yaml,
    read_bytes,
    read_json,
    read_mapping,
    read_npz,
    read_yaml,
)


def laughs() -> str:
    rows = ['a0: &a0 [x, x, x, x, x, x, x, x, x, x]']
    rows += [f'a{i}: &a{i} [{", ".join([f"*a{i - 1}"] * 10)}]' for i in range(1, 12)]
    return '\n'.join(rows)


JSON = {
    'nested': '[' * 100_000, 'nested and closed': '[' * 500 + ']' * 500, 'NaN': '{"a": NaN}',
    'infinity': '[-Infinity]', 'overflow': '[1e999]', 'huge integer': '[1' + '0' * 400 + ']',
    'digits': '[' + '9' * 100_000 + ']', 'twice': '{"a": 1, "a": 2}', 'empty': '', 'torn': '{"a": ',
}  # fmt: skip
YAML = {
    'nested': '[' * 100_000, 'laughs': laughs(), 'tag': '!!python/object/apply:os.system [true]',
    'twice': 'a: 1\na: 2', 'itself': '&a [*a]', 'torn': 'a: [', 'date': 'a: 2026-99-99',
    'huge integer': 'a: 1' + '0' * 400,
}  # fmt: skip


@pytest.mark.parametrize('case', JSON)
def test_json_of_a_stranger_is_refused_by_name(case, tmp_path):
    file = tmp_path / 'status.json'
    file.write_text(JSON[case])
    with pytest.raises(FileError, match='status.json'):
        read_json(file)


@pytest.mark.parametrize('case', YAML)
def test_yaml_of_a_stranger_is_refused_by_name(case, tmp_path):
    file = tmp_path / 'job.yaml'
    file.write_text(YAML[case])
    with pytest.raises(FileError, match='job.yaml'):
        read_yaml(file)


def test_what_we_write_is_read(tmp_path):
    data = {'a': [1, 2.5, None, True, 'x'], 'b': {'c': 'ü' * 10}, 'n': 2**63}
    assert parse_json(json.dumps(data), 'x') == data
    assert parse_yaml(yaml.safe_dump(data), 'x') == data
    shared = [1, 2]  # aliases are written for it
    assert parse_yaml(yaml.safe_dump({'a': shared, 'b': shared}), 'x') == {'a': shared, 'b': shared}
    assert parse_yaml('base: &b {x: 1}\nmore:\n  <<: *b\n  y: 2', 'x')['more'] == {'x': 1, 'y': 2}


@pytest.mark.parametrize('data', [b'\xff\xfe', b'\x80abc', bytes(range(256))])
def test_bytes_that_are_no_text_are_refused(data, tmp_path):
    for name in ('a.json', 'a.yaml'):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(FileError, match=name):
            read_mapping(tmp_path / name)


def test_a_list_is_no_mapping(tmp_path):
    (tmp_path / 'a.json').write_text('[1]')
    with pytest.raises(FileError, match='no mapping'):
        read_mapping(tmp_path / 'a.json')


# ---- where a file lies


def test_links_are_followed_to_nowhere(tmp_path):
    job, secret = tmp_path / 'job', tmp_path / 'secret'
    job.mkdir()
    secret.mkdir()
    (secret / 'a').write_text('told to nobody')
    (job / 'link').symlink_to(secret / 'a')
    (job / 'chain').symlink_to('link')
    (job / 'layers').symlink_to(secret)
    (job / 'loop').symlink_to('loop')
    (job / 'gone').symlink_to('nothing')
    for name in ('link', 'chain', 'layers/a', 'loop', 'gone', '../secret/a'):
        with pytest.raises(FileError):
            read_bytes(job / name, job)
        assert not is_file(job / name) or name in ('layers/a', '../secret/a')
    with pytest.raises(FileError, match='not below'):
        read_bytes(secret / 'a', job)
    assert read_bytes(secret / 'a') == b'told to nobody'


def test_what_is_no_file_is_refused_and_nobody_waits(tmp_path):
    os.mkfifo(tmp_path / 'fifo')
    (tmp_path / 'folder').mkdir()
    for name in ('fifo', 'folder'):
        assert not is_file(tmp_path / name)
        found: list[Exception] = []

        def read(name=name, found=found):
            try:
                read_bytes(tmp_path / name)
            except FileError as e:
                found.append(e)

        thread = threading.Thread(target=read, daemon=True)
        thread.start()
        thread.join(20.0)
        assert found, f'{name}: still waiting'
    with pytest.raises(FileError, match='regular'):
        read_bytes(type(tmp_path)('/dev/zero'))
    with pytest.raises(Missing):
        read_bytes(tmp_path / 'nothing')


def test_a_file_above_the_limit_and_one_that_shrinks(tmp_path, monkeypatch):
    file = tmp_path / 'a.json'
    file.write_bytes(b'x' * 1000)
    with pytest.raises(FileError, match='at most 999'):
        read_bytes(file, limit=999)
    with open(tmp_path / 'sparse', 'wb') as f:
        f.truncate(1 << 40)
    with pytest.raises(FileError, match='at most'):
        read_bytes(tmp_path / 'sparse')
    inner, asked = os.fstat, []

    def shrinking(descriptor):
        found = inner(descriptor)
        asked.append(found)
        if len(asked) == 2:  # the first one asks for the kind
            os.truncate(file, 10)
        return found

    monkeypatch.setattr(os, 'fstat', shrinking)
    with pytest.raises(FileError, match='size changed'):
        read_bytes(file)


# ---- arrays


def npz(file, **members: bytes):
    with zipfile.ZipFile(file, 'w', zipfile.ZIP_DEFLATED) as z:
        for name, data in members.items():
            z.writestr(f'{name}.npy', data)


def header(shape: str, kind: str = '<f8') -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + '\n'
    return b'\x93NUMPY\x01\x00' + len(text).to_bytes(2, 'little') + text.encode()


@pytest.mark.parametrize(
    'data',
    [
        header('(1000000000000,)'), header('(1000000, 1000000)'), header('(-1, -8)') + b'0' * 64,
        header('(4,)') + b'0' * 16, header('(2,)', '|O') + b'0' * 16, b'', b'\x93NUMPY', b'PK' * 50,
        header('((((', '<f8'), header('(0,)' + ' ' * 20) + b'1', header('(2,)', '|V0'),
    ],
)  # fmt: skip
def test_arrays_that_claim_what_they_do_not_hold_are_refused(data, tmp_path):
    npz(tmp_path / 'scan_000.npz', z=data)
    with pytest.raises(FileError, match='scan_000.npz'):
        read_npz(tmp_path / 'scan_000.npz')


def test_a_bomb_is_not_unpacked(tmp_path):
    npz(tmp_path / 'a.npz', z=header('(4000000,)') + bytes(32_000_000))
    assert (tmp_path / 'a.npz').stat().st_size < 100_000
    with pytest.raises(FileError, match='more than'):
        read_npz(tmp_path / 'a.npz', limit=1 << 20)


@given(
    st.sampled_from(['<f8', '<f4', '|b1', '<u2', '<U7']),
    st.lists(st.integers(0, 4), max_size=3),
    st.booleans(),
)
def test_arrays_come_back_as_they_were_stored(kind, shape, fortran):
    rng = np.random.default_rng(1)
    array = np.asarray(rng.integers(0, 9, shape).astype(kind), order='F' if fortran else 'C')
    buffer = io.BytesIO()
    np.savez_compressed(buffer, a=array, about=np.array('{"x": 1}'))
    file = _on_disk(buffer.getvalue())
    found = read_npz(file)
    file.unlink()
    assert found['a'].dtype == array.dtype and np.array_equal(found['a'], array)
    assert str(found['about']) == '{"x": 1}' and found['a'].flags.writeable


def _on_disk(data: bytes):
    import tempfile
    from pathlib import Path

    with tempfile.NamedTemporaryFile(suffix='.npz', delete=False) as f:
        f.write(data)
    return Path(f.name)


@given(st.data())
def test_damaged_arrays_are_an_error_or_what_was_stored(data):
    buffer = io.BytesIO()
    np.savez_compressed(buffer, z=np.arange(300.0).reshape(15, 20), sigma=np.ones(5, np.float32))
    content = bytearray(buffer.getvalue())
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    else:
        for at in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=8)):
            content[at] = data.draw(st.integers(0, 255))
    file = _on_disk(bytes(content))
    try:
        found = read_npz(file)
    except FileError as e:
        assert str(file) in str(e)
    else:
        assert all(isinstance(a, np.ndarray) for a in found.values())
    finally:
        file.unlink()


@given(st.text(max_size=200))
def test_any_text_is_data_or_an_error(text):
    for parse in (parse_json, parse_yaml):
        try:
            parse(text, 'x.y')
        except FileError as e:
            assert 'x.y' in str(e)


def test_opened_gives_the_file_and_closes_it(tmp_path):
    (tmp_path / 'a').mkdir()
    (tmp_path / 'a' / 'b').write_text('c')
    with opened(tmp_path / 'a' / 'b', tmp_path) as f:
        assert f.read() == b'c'
    assert f.closed
