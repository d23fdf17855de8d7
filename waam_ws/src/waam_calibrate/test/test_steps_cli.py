"""Steps per mm from a gauge to the controller: a gantry with a wrong scale, the real controller core, the verbs."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / 'waam_firmware/test'))
from shaper_machine import Machine  # noqa: E402

from waam_calibrate import cli  # noqa: E402
from waam_calibrate.evidence import EvidenceError  # noqa: E402
from waam_calibrate.graph import Graph  # noqa: E402

TRUE = (321.917, 317.203, 322.5)  # steps that a mm of this gantry takes; its controller has 320
AXES = 'xyz'


class Cell:
    """The verbs, and the controller that they tell. `machine` None: no graph is up."""

    def __init__(self, folder: Path, machine: Machine | None) -> None:
        self.machine, self.folder = machine, folder
        graph = Graph(lambda: folder, lambda p: None, self.none, self.send, self.told, self.none)
        self._parser = argparse.ArgumentParser()
        cli.register(self._parser.add_subparsers(), graph)

    def none(self, *_: object) -> None:
        raise AssertionError('not asked for here')

    def told(self, _: argparse.Namespace) -> dict[str, float] | None:
        if self.machine is None:
            return None
        found = re.findall(r'(\w+)=([\d.]+)', self.machine.ask('$L'))
        return {name: float(value) for name, value in found}

    def send(self, _: argparse.Namespace, settings: list[tuple[str, float]]) -> str:
        answer = ''
        for name, value in settings:
            answer = self.machine.ask(f'$C {name} {value:.5f}')
            if 'error' in answer:
                raise RuntimeError(answer)
        return ''

    def verb(self, line: str) -> int:
        args = self._parser.parse_args(['calibrate', *line.split()])
        return int(args.run_command(args))


def gauge(m: Machine, axis: int) -> str:
    """Commanded and measured travels in one direction, by the true place of the machine, read to 0.01 mm."""
    stops = (40.0, 90.0, 150.0, 190.0)
    start, measured = 5.0, []
    for stop in stops:
        m.run(f'G1 {"XYZ"[axis]}{start} F6000')
        before = m.place()[axis]
        m.run(f'G1 {"XYZ"[axis]}{stop}')
        measured.append(m.place()[axis] - before)
    commanded = [stop - start for stop in stops]
    return f'--commanded {" ".join(map(str, commanded))} --measured {" ".join(f"{v:.2f}" for v in measured)}'


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_a_gantry_with_a_wrong_scale_is_measured_told_and_true(axis: int, tmp_path, capsys) -> None:
    m = Machine(true_steps=TRUE)
    cell = Cell(tmp_path, m)
    name = f'steps_per_mm_{AXES[axis]}'
    assert cell.verb(f'steps --axis {AXES[axis]} {gauge(m, axis)}') == 0
    assert 'controller: told; home the machine again' in capsys.readouterr().out
    assert cell.told(None)[name] == pytest.approx(TRUE[axis], rel=1e-4)
    assert m.ask('$X') == '$X ok', 'it survives a reset'
    m.run('G28')
    m.run('G1 X0 Y0 Z200 F6000', f'G1 {"XYZ"[axis]}50')
    before = m.place()[axis]
    m.run(f'G1 {"XYZ"[axis]}190')
    assert m.place()[axis] - before == pytest.approx(140.0, abs=0.015)
    assert cell.verb('status') == 0
    assert 'apply' not in capsys.readouterr().out
    # a second time it starts from what the controller has now
    assert cell.verb(f'steps --axis {AXES[axis]} {gauge(m, axis)}') == 0
    assert cell.told(None)[name] == pytest.approx(TRUE[axis], rel=1e-4)


def test_a_controller_that_lost_its_power_is_noticed_and_told_again(tmp_path, capsys) -> None:
    cell = Cell(tmp_path, Machine(true_steps=TRUE))
    assert cell.verb(f'steps --axis y {gauge(cell.machine, 1)}') == 0
    cell.machine = Machine(true_steps=TRUE)
    assert cell.verb('status') == 1
    said = capsys.readouterr().out
    assert 'steps_per_mm_y is 320 in the controller, 317.2' in said and 'a job will refuse' in said
    assert cell.verb('apply') == 0 and cell.verb('status') == 0
    assert cell.told(None)['steps_per_mm_y'] == pytest.approx(TRUE[1], rel=1e-4)


def test_poor_evidence_is_refused_and_tells_the_controller_nothing(tmp_path) -> None:
    cell = Cell(tmp_path, Machine(home=False))
    for measured in ('49.9 151.2 249.1', '25.0 75.0 125.0', '50 150'):
        with pytest.raises(EvidenceError):
            cell.verb(f'steps --axis x --commanded 50 150 250 --measured {measured}')
    assert cell.told(None)['steps_per_mm_x'] == 320 and not list(tmp_path.iterdir())


def test_without_a_graph_the_present_steps_must_be_said(tmp_path, capsys) -> None:
    cell = Cell(tmp_path, None)
    lengths = '--commanded 50 150 250 --measured 50.1 150.3 250.5'
    with pytest.raises(EvidenceError, match='give --steps-per-mm'):
        cell.verb(f'steps --axis x {lengths}')
    assert cell.verb(f'steps --axis x --steps-per-mm 200 {lengths}') == 0
    assert 'waam calibrate apply tells the controller' in capsys.readouterr().out
    (path,) = tmp_path.glob('steps_x*.yaml')
    assert '199.601' in path.read_text()


def test_a_dry_run_keeps_and_tells_nothing(tmp_path) -> None:
    cell = Cell(tmp_path, Machine(home=False))
    lengths = '--commanded 50 150 250 --measured 50.1 150.3 250.5'
    assert cell.verb(f'steps --axis x --dry-run {lengths}') == 0
    assert cell.told(None)['steps_per_mm_x'] == 320 and not list(tmp_path.iterdir())
