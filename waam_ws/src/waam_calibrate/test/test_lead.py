"""Lead of the wire: found from a recorded bead on the real controller core, told to it, and metal that is even then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from steps_bead import Layer, cornered, metal_errors

from waam_bridge import commands
from waam_calibrate import outcome, pictures
from waam_calibrate.evidence import EvidenceError
from waam_calibrate.lead import WireRecord, follow, identify, program
from waam_plan.import_gcode.files import load_dialect
from waam_plan.import_gcode.reader import read_program
from waam_sim.arc import ArcParams
from waam_sim.plant import PlantParams

TRUE = (0.07, 0.14)


def test_calibrated_lead_lays_even_metal() -> None:
    corners, speeds = cornered()
    aside = [(x, y - 20e-3, z) for x, y, z in corners]
    with Layer(PlantParams(arc=ArcParams(wire_delay=TRUE[0], wire_lag=TRUE[1]))) as layer:
        layer.bead(corners, speeds)
        record, before = layer.take()
        found = identify(record, reading=0.01)
        assert found.delay == pytest.approx(TRUE[0], abs=2e-3)
        assert found.lag == pytest.approx(TRUE[1], abs=3e-3)
        layer.configure(found.settings())
        layer.bead(aside, speeds)
        _, after = layer.take()
    plain = np.abs(metal_errors(before, corners, 6e-3)).max()
    led = np.abs(metal_errors(after, aside, 6e-3)).max()
    assert led < 0.03 < 0.08 < plain
    result = outcome.of_lead(found)
    assert [n for n, _ in result.settings] == ['wire_response_s', 'wire_delay_s', 'wire_lag_s']
    assert not result.refuses and pictures.wire_steps(found).startswith(b'\x89PNG')


def test_the_controller_refuses_a_lead_that_makes_no_sense() -> None:
    with Layer(PlantParams()) as layer:

        def told(name: str, value: float) -> tuple[int, str]:
            order = commands.Command(commands.CONFIGURE, name, (), (0, 0, 0), value)
            return layer.machine.command(order)

        absurd = {
            'wire_delay_s': 0.3,
            'wire_lag_s': -0.1,
            'wire_response_s': 0.0,
            'wire_underfeed_ratio': 1.0,
        }
        for name, value in absurd.items():
            code, said = told(name, value)
            assert code != 0 and name in said and 'must lie within' in said
        assert told('wire_underfeed_ratio', 0.8)[0] == 0
        layer.configure([('shape_x_hz', 20.0), ('shape_x', 1.0)])  # a mean delay of 12.5 ms
        code, said = told('wire_delay_s', 0.0)
        assert code == 0, said  # the response of 20 ms is enough
        code, said = told('wire_response_s', 0.01)
        assert code != 0 and 'slower than the lead' in said
        assert told('wire_delay_s', 0.05)[0] == 0 and told('wire_response_s', 0.01)[0] == 0


def made_up(delay: float, lag: float, noise: float = 0.0, high: float = 1.5) -> WireRecord:
    """A bead with a step every 1.5 s."""
    at = 100.0 + np.arange(0, 20, 0.01)
    commanded = np.where((at // 1.5).astype(int) % 2, high * 0.08, 0.08)
    x = follow(at - 100, commanded, np.arange(0, 20.01, 1e-3), delay, lag)
    x = x + noise * np.random.default_rng(1).standard_normal(len(at))
    return WireRecord(at, commanded, x, np.ones(len(at), bool))


@given(st.floats(0.0, 0.2), st.floats(0.01, 0.4), st.floats(1.2, 2.0))
@settings(max_examples=12, deadline=None)
def test_delay_and_lag_are_found(delay, lag, high) -> None:
    found = identify(made_up(delay, lag, 5e-4, high))
    assert found.delay == pytest.approx(delay, abs=6e-3)
    assert found.lag == pytest.approx(lag, abs=max(6e-3, 0.03 * lag))
    assert abs(found.delay + found.lag - delay - lag) < 6e-3


def test_poor_records_are_refused_with_the_reason() -> None:
    good = made_up(0.05, 0.1)
    n = len(good.time)
    for text, bad in (
        (
            'no bead',
            WireRecord(*(c[:50] for c in (good.time, good.commanded, good.measured, good.burns))),
        ),
        ('steps of the wire', made_up(0.05, 0.1, high=1.02)),
        ('never burns', replace(good, burns=np.zeros(n, bool))),
        ('not a finite', replace(good, measured=np.full(n, np.nan))),
        ('do not rise', replace(good, time=np.zeros(n))),
        ('frames per second', replace(good, time=100 + 0.1 * np.arange(n))),
        ('is missing', replace(good, time=good.time + 0.5 * (good.time > 110))),
        ('always reads the same', replace(good, measured=np.full(n, 0.08))),
        ('wire wheel first', replace(good, measured=0.5 * good.measured)),
        ('unexplained', replace(good, measured=good.measured[::-1].copy())),
        ('unexplained', made_up(0.05, 0.1, noise=0.02)),
    ):
        with pytest.raises(EvidenceError, match=text):
            identify(bad)


def test_a_wire_that_is_too_late_is_refused_by_jobs() -> None:
    result = outcome.of_lead(identify(made_up(0.3, 0.1)))
    assert 'the controller leads at most' in result.refuses
    assert dict(result.settings)['wire_delay_s'] == 0.25


def test_the_program_of_the_bead_is_one_that_jobs_run() -> None:
    found = read_program(program(0.08, 8e-3, 12e-3, 11), load_dialect('waam'))
    lit = [m for m in found.motions if m.arc]
    assert len(lit) == 12
    assert [m.wire / m.speed for m in lit] == pytest.approx([10.0] * 12, rel=1e-3)
    assert lit[1].speed == pytest.approx(12e-3) and lit[0].speed == pytest.approx(8e-3)
