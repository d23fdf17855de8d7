"""Simulated time while a job computes: no faster than the wall clock where the machine stands, free otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from waam_process.plant_port import SAMPLE
from waam_sim.pace import ARC, MAX_WAIT, Pace

STEP_US = 10_000
COMPUTED = 5e-4  # s of the wall clock that a step takes by itself


class Run:
    """Steps of a cell, and the wall clock that they would take."""

    def __init__(self) -> None:
        self.pace, self.time_us, self.wall, self.x = Pace(), 1_700_000_000_000_000, 50.0, 0.0

    def steps(
        self, seconds: float, computes: bool = True, speed: float = 0.0, outputs: int = 0
    ) -> float:
        """Simulated seconds; s of the wall clock that they took."""
        began = self.wall
        for _ in range(round(1e6 * seconds / STEP_US)):
            samples = np.zeros(10, SAMPLE)
            samples['table_x'] = self.x + speed * 1e-3 * np.arange(1, 11)
            samples['outputs'] = outputs
            self.x = float(samples['table_x'][-1])
            self.time_us += STEP_US
            self.wall += COMPUTED
            self.wall += self.pace.ahead(samples, self.time_us, self.wall, computes)
        return self.wall - began


@pytest.fixture
def run() -> Run:
    made = Run()
    made.steps(0.1, computes=False)
    return made


def test_a_second_of_standstill_takes_a_second_while_the_job_computes(run):
    assert run.steps(1.0) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(
    'otherwise',
    [{'computes': False}, {'speed': 0.01}, {'outputs': ARC}],
    ids=lambda o: next(iter(o)),
)
def test_time_runs_free_when_the_job_waits_or_the_machine_works(run, otherwise):
    assert run.steps(2.0, **otherwise) == pytest.approx(200 * COMPUTED)


def test_what_was_slow_by_itself_is_not_slowed_down(run):
    run.steps(0.02)
    run.wall += 0.5  # a step that the computer was late with
    assert run.steps(0.4) == pytest.approx(40 * COMPUTED)


def test_a_new_standstill_is_timed_from_its_own_beginning(run):
    run.steps(0.5)
    run.steps(3.0, speed=0.01)
    assert run.steps(0.5) == pytest.approx(0.5, abs=0.03)


def test_a_job_that_computes_for_very_long_waits_for_something(run):
    assert run.steps(MAX_WAIT + 20.0) < MAX_WAIT + 20.0 / 10
