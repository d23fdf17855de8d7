"""Calls of compiled functions: record types that are one object, and calls whose types are settled."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from waam_process.plant_port import SAMPLE
from waam_sim.compiled import Settled, record, state
from waam_sim.heat import HeatParams
from waam_sim.part import plate
from waam_sim.plant import Plant


@numba.njit
def weigh(values, p, factor):
    """A sum that depends on the type of the values, on the record and on the type of the factor."""
    return values.sum() * p[0].cell * (factor / 2)


def test_records_with_the_same_fields_have_one_type():
    assert record(HeatParams()).dtype is record(HeatParams(cell=5e-3)).dtype
    assert state('a', 'b').dtype is state('a', 'b').dtype
    assert state('a', 'b').dtype != state('b', 'a').dtype
    assert record(HeatParams(cell=5e-3))['cell'] == 5e-3


def test_a_settled_call_says_what_the_function_says():
    settled, p = Settled(weigh), record(HeatParams(cell=2.0))
    values = np.array([1.0, 2.0, 4.0])
    assert settled((values, p), 3.0) == weigh(values, p, 3.0) == 21.0
    values[0] = 2.0
    assert settled((values, p), 3.0) == 24.0


@pytest.mark.parametrize(
    'other',
    [
        np.array([1, 2, 4]),
        np.array([1.0, 9.0, 2.0, 9.0, 4.0])[::2],
        np.array([1.0, 2.0], np.float32),
    ],
    ids=['whole numbers', 'every other one', 'single precision'],
)
def test_another_array_may_have_another_type(other):
    settled, p = Settled(weigh), record(HeatParams(cell=2.0))
    settled((np.array([5.0]), p), 3.0)
    assert settled((other, p), 3.0) == weigh(other, p, 3.0) == other.sum() * 3.0


def test_a_number_of_another_type_is_not_cut():
    settled, arrays = Settled(weigh), (np.array([1.0]), record(HeatParams(cell=2.0)))
    assert settled(arrays, 1) == 1.0
    assert settled(arrays, 1.5) == 1.5


def test_samples_that_are_not_in_a_row_are_lived_through_as_they_are():
    """The compiled loop takes them for samples in a row."""
    samples = np.zeros(20, SAMPLE)
    samples['table_x'] = -np.linspace(0.1, 0.11, 20)
    places = []
    for taken in (samples[::2], samples[::2].copy()):
        plant = Plant(plate(0.03, 0.03, 0.01, 4e-4, 2e-3))
        plant.step(np.zeros(10, SAMPLE), 10_000)
        plant.step(taken, 20_000)
        places.append(plant._last.copy())
    assert np.array_equal(*places)
