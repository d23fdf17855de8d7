"""The verbs wire, lead and arc as a user calls them: what is kept, told and refused."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest
from test_lead import made_up

from waam_calibrate import cli
from waam_calibrate.evidence import EvidenceError
from waam_calibrate.graph import Graph
from waam_calibrate.lead import WireRecord

WIRE = 'wire --counts-per-turn 4096 --length 500 500 500 --counted 18624 18619 18630 --controller'


@pytest.fixture
def told() -> list[tuple[str, float]]:
    return []


@pytest.fixture
def record() -> dict[str, WireRecord]:
    """What a recording holds, by its name."""
    return {}


@pytest.fixture
def waam(tmp_path: Path, told, record):
    def send(args: argparse.Namespace, settings: list[tuple[str, float]]) -> str:
        told.extend(settings)
        return '$C ok'

    def measure(*_: object) -> None:
        raise AssertionError('nothing is shaken here')

    graph = Graph(
        lambda: tmp_path / 'kept', lambda p: None, measure, send, lambda args: None,
        lambda path: record.get(path.name, made_up(0.05, 0.12)),
    )  # fmt: skip
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers(), graph)

    def run(line: str) -> int:
        args = parser.parse_args(['calibrate', *line.split()])
        return int(args.run_command(args))

    return run


def test_wire_and_lead_are_kept_shown_and_told(waam, told, tmp_path, capsys) -> None:
    assert waam(f'{WIRE} 37.25') == 0
    assert waam('lead --record somewhere --reading 0') == 0
    assert sorted(p.name.split('_')[0] for p in (tmp_path / 'kept').glob('*.html')) == [
        'lead', 'wire',
    ]  # fmt: skip
    capsys.readouterr()
    assert waam('status') == 0
    said = capsys.readouterr().out
    assert 'wire delay 50.' in said and 'counts/mm' in said
    assert waam('apply') == 0
    names = [name for name, _ in told]
    # the oldest result comes first, and both may be of the same second
    lead = ['wire_response_s', 'wire_delay_s', 'wire_lag_s']
    assert names in (['wire_underfeed_ratio', *lead], [*lead, 'wire_underfeed_ratio'])
    assert dict(told)['wire_lag_s'] == pytest.approx(0.12, abs=2e-3)


def test_a_wheel_that_reads_wrong_stops_jobs(waam, capsys) -> None:
    assert waam(f'{WIRE} 40') == 0
    assert waam('status') == 1
    assert 'a job will refuse: wire: the wire feed reads -6.9 % wrong' in capsys.readouterr().out


def test_what_writes_no_result(waam, tmp_path) -> None:
    with pytest.raises(EvidenceError, match='counts 3'):
        waam('wire --counts-per-turn 20 --length 500 500 500 --counted 91 91 91')
    assert waam(f'lead --program {tmp_path}/steps.gcode') == 0
    assert 'M3' in (tmp_path / 'steps.gcode').read_text()
    assert not (tmp_path / 'kept').exists()


@pytest.mark.parametrize('poor', ['flat', 'noisy'])
def test_a_poor_record_of_the_wire_keeps_and_tells_nothing(waam, record, told, poor, tmp_path):
    """The bead has no steps of speed, or the encoder's noise hides them."""
    record['flat'] = made_up(0.05, 0.12, high=1.0)
    record['noisy'] = made_up(0.05, 0.12, noise=0.02)
    reason = {'flat': 'steps of the wire', 'noisy': 'unexplained'}[poor]
    with pytest.raises(EvidenceError, match=reason):
        waam(f'lead --record {poor}')
    assert not (tmp_path / 'kept').exists() and not told
