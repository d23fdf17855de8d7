"""Map files, and what is left out of several files."""

import numpy as np
import pytest

from waam_process.grid import GridSpec
from waam_scan.left_out import LeftOut, NothingLeft
from waam_scan.map_file import FileError, load_map, save_map


def test_missing_empty_and_binary_files(tmp_path):
    for name, data in (('empty', b''), ('binary', bytes(range(256)) * 20)):
        (tmp_path / name).write_bytes(data)
    for path in (tmp_path / 'absent', tmp_path, tmp_path / 'empty', tmp_path / 'binary'):
        with pytest.raises(FileError, match=str(path)):
            load_map(path)


def test_a_map_survives_the_file(tmp_path):
    spec = GridSpec(0.1, -0.2, 0.5e-3, 3, 4)
    z = np.arange(12.0).reshape(3, 4) * 1e-3
    z[1, 1] = np.nan
    save_map(
        tmp_path / 'm.npz', spec, z, z * 0 + 1e-5, np.ones((3, 4), np.uint16), layer=np.array(2)
    )
    back = load_map(tmp_path / 'm.npz')
    assert back.spec == spec
    assert np.allclose(back.z, z, equal_nan=True)
    np.savez(tmp_path / 'other.npz', a=np.zeros(3))
    with pytest.raises(FileError, match='not a height map'):
        load_map(tmp_path / 'other.npz')


def test_many_bad_ones_are_counted_not_listed():
    left_out = LeftOut()
    for line in range(5, 505):
        left_out.add('profile', 'a.csv', f'line {line}', 'not a number')
    lines = left_out.lines()
    assert len(lines) == 14
    assert '488 more of its profiles, the last one line 504' in lines[-2]
    assert lines[-1] == '500 profiles left out; the rest is used'
    assert isinstance(left_out.nothing_left('x'), NothingLeft)
