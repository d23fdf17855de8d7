"""`waam commission` on a graph: virtual controller on its pty, simulated cell as delivered, and a person who presses,
looks and measures there. The wizard is told nothing of what is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from waam_bringup import cell_check, cell_graph, cli
from waam_bringup.commission import Shelf, go_on
from waam_bringup.commission_cell import CommissionedCell
from waam_bringup.commission_hand import Hand
from waam_bringup.commission_steps import Visit, run
from waam_bringup.graph import Settings
from waam_bringup.operate import graph
from waam_calibrate.commission import BUILT, BY_NAME, FAILED, NOT_DONE, Outcome
from waam_node.testing import fresh_domain

NAME = 'hidden'
NOT_NEEDED = (
    'scan_fusion', 'correction_server', 'feed_forward', 'thermal_compensator', 'process_control', 'recorder',
    'dashboard', 'panel',
)  # fmt: skip
STEPS = {'x': 328.7, 'y': 312.4, 'z': 325.1}  # per mm, of the machine; the controller has 320
OFF = {
    'arc_wire_ratio': 1.041, 'delivered_skew': 0.18, 'delivered_current_scale': 1.048, 'delivered_voltage_scale': 0.953,
}  # fmt: skip


@pytest.fixture(autouse=True)
def folders(tmp_path, monkeypatch):
    for name in ('JOBS', 'CELLS', 'CALIBRATIONS'):
        monkeypatch.setenv(f'WAAM_{name}', str(tmp_path / name.lower()))
    monkeypatch.setenv('WAAM_CELL', NAME)
    assert cli.main(['cell', 'new', NAME]) == 0


@contextmanager
def started(
    tmp_path: Path, hidden: dict, steps=(320.0, 320.0, 320.0)
) -> Iterator[tuple[Path, int]]:
    """The cell as delivered, on its graph: folder and domain."""
    file = tmp_path / 'delivered.yaml'
    file.write_text(yaml.safe_dump({'/**/cell': {'ros__parameters': hidden}}))
    settings = Settings(
        run=tmp_path / 'run', seed=3, machine_steps=steps, params_files=(file,), without=NOT_NEEDED
    )
    domain = fresh_domain()
    with graph(cell_graph.apply(settings, True).settings, domain, timeout=90.0):
        yield settings.run, domain


def shelf(tmp_path: Path) -> Shelf:
    kept = tmp_path / 'calibrations' / 'cells' / NAME
    return Shelf(cell_check.load(cell_check.path_of(NAME)), kept)


def test_a_cell_that_is_off_is_measured_and_passes(tmp_path, capfd):
    with (
        started(tmp_path, OFF, tuple(STEPS.values())) as (_, domain),
        CommissionedCell(domain) as cell,
    ):
        hand, said = Hand(cell), []
        assert go_on(shelf(tmp_path), cell, hand, say=said.append) == 0, said
        told = cell.told()
    again = shelf(tmp_path)
    assert again.book.passed == len(BUILT) and again.book.due() is None
    for axis, true in STEPS.items():
        assert told[f'steps_per_mm_{axis}'] == pytest.approx(true, rel=1e-3)
    found = {name: e.outcome for name, e in again.book.entries.items()}
    assert found['skew'].checks[0].value == pytest.approx(0.18, abs=0.02)
    assert [c.value for c in found['signals'].checks] == pytest.approx([1.048, 0.953], abs=0.01)
    assert found['wire'].checks[0].value == pytest.approx(100 * (1 / 1.041 - 1), abs=0.2)
    assert hand.asked.count('directions.z') == 1 and len(hand.asked) <= 31
    assert cli.main(['commission', NAME, '--list']) == 0
    assert f'{len(BUILT)} of {len(BUILT)} steps passed' in capfd.readouterr().out
    assert cli.main(['commission', NAME, '--page']) == 0
    assert 'This cell is not ready' not in Path(capfd.readouterr().out.strip()).read_text()


def test_what_is_connected_wrongly_is_found_each_in_its_step(tmp_path):
    hidden = {
        'delivered_limits': 'bridged', 'delivered_current_scale': -1.0, 'delivered_thermocouple_swapped': True,
        'delivered_xy_swapped': True, 'delivered_gas_valve': 'stuck_closed', 'delivered_skew': 0.5,
    }  # fmt: skip
    with started(tmp_path, hidden) as (_, domain), CommissionedCell(domain) as cell:
        hand, on = Hand(cell), shelf(tmp_path)

        def step(name: str) -> Outcome:
            return run(Visit(BY_NAME[name], cell, hand, on.file, on.kept, patience=15.0))

        assert step('estop').passed and step('rest').passed
        for name, said in (
            ('limits', 'no change'),
            ('signals', 'upside down'),
            ('temperature', 'by a warm hand -'),
            ('directions', 'x was told to go +x and went +y'),
            ('gas', '207'),
            ('skew', 'y leans'),
        ):
            found = step(name)
            assert not found.passed and said in found.text and found.mend, (name, found)
            if name == 'directions':
                assert step('homing').passed


def test_a_reversed_emergency_stop_ends_the_run_and_keeps_the_gates_closed(tmp_path, capfd):
    answers = tmp_path / 'answers.yaml'
    answers.write_text('estop.released: yes\n')
    with started(tmp_path, {'delivered_estop': 'reversed'}) as (folder, domain):
        where = ('--run', str(folder), '--domain', str(domain), '--answers', str(answers))
        assert cli.main(['commission', NAME, *where]) == 1
        said = capfd.readouterr().out
        assert 'the emergency stop is still active' in said and 'reversed' in said
        assert cli.main(['commission', NAME, *where, '--step', 'limits']) == 2
        assert 'limits is not due: estop is failed' in capfd.readouterr().err
        assert cli.main(['commission', NAME, *where, '--step', 'link']) == 0
    book = shelf(tmp_path).book
    assert book.state('estop') == FAILED and book.state('limits') == NOT_DONE
    assert book.state('settings') == 'out of date'


def test_without_cell_file_graph_or_answer_it_says_so(tmp_path, capfd):
    assert cli.main(['commission', 'nobody']) == 2
    assert 'waam cell new nobody' in capfd.readouterr().err
    assert cli.main(['commission', NAME, '--run', str(tmp_path / 'run')]) == 2
    assert 'waam up' in capfd.readouterr().err
    assert cli.main(['commission', NAME, '--step', 'first-arc']) == 2
    assert 'docs/real_cell.md' in capfd.readouterr().err
