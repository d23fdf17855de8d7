"""What was written before the loop mode had its name is read all the same."""

from __future__ import annotations

import pytest

from waam_process.loop_mode import with_loop_mode


@pytest.mark.parametrize(
    'stored,read',
    [
        ({'profile': 'monitor', 'layer': 2}, {'loop_mode': 'monitor', 'layer': 2}),
        ({'loop_mode': 'monitor'}, {'loop_mode': 'monitor'}),
        ({'loop_mode': 'monitor', 'profile': 'a note of the user'}, {'loop_mode': 'monitor'}),
        ({}, {}),
    ],
)
def test_fields_of_before_are_read_by_their_new_name(stored, read):
    before = dict(stored)
    assert with_loop_mode(stored) == read
    assert stored == before
