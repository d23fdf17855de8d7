"""`waam commission` on a graph: virtual controller on its pty, simulated cell as delivered, and a person who presses,
looks and measures there. The wizard is told nothing of what is wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import yaml

from waam_bringup import cell_check, cell_graph, cli, paths
from waam_bringup.commission import AnswerFile, Shelf, go_on
from waam_bringup.commission_arc import Paused
from waam_bringup.commission_axes import LENGTHS, WIRE_MM
from waam_bringup.commission_cell import CommissionedCell
from waam_bringup.commission_hand import AMPERES, HOTTER_K, VOLTS, Hand, write_pad
from waam_bringup.commission_steps import run
from waam_bringup.commission_visit import Question, Visit
from waam_bringup.graph import Settings
from waam_bringup.operate import graph
from waam_calibrate.commission import (
    BUILT,
    BY_NAME,
    FAILED,
    NOT_DONE,
    NOT_THERE,
    CommissionError,
    Outcome,
)
from waam_msgs.msg import JobStatus
from waam_node.testing import fresh_domain
from waam_scan.calibration.file import load_calibration

NAME = 'hidden'
NOBODY_LOOKS = ('dashboard', 'panel')
NO_JOBS = (
    'correction_server', 'feed_forward', 'thermal_compensator', 'process_control', 'recorder', *NOBODY_LOOKS,
)  # fmt: skip
STEPS = {'x': 328.7, 'y': 312.4, 'z': 325.1}  # per mm, of the machine; the controller has 320
WIRE, SKEW, DELAY_S, LAG_S, AMBIENT_C = 1.041, 0.18, 0.045, 0.09, 22.0
OFF = {
    'arc_wire_ratio': WIRE, 'arc_wire_delay': DELAY_S, 'arc_wire_lag': LAG_S, 'delivered_skew': SKEW,
    'delivered_current_scale': 1.048, 'delivered_voltage_scale': 0.953, 'pyrometer_emissivity': 0.62,
}  # fmt: skip
SCANNER = {
    'delivered_scanner_x': 0.004, 'delivered_scanner_y': -0.005, 'delivered_scanner_z': 0.004,
    'delivered_scanner_roll': 1.9, 'delivered_scanner_pitch': -1.8, 'delivered_scanner_yaw': 2.0,
    'delivered_scanner_late': 0.08,
}  # fmt: skip


@pytest.fixture(autouse=True)
def folders(tmp_path, monkeypatch):
    for name in ('JOBS', 'CELLS', 'CALIBRATIONS'):
        monkeypatch.setenv(f'WAAM_{name}', str(tmp_path / name.lower()))
    monkeypatch.setenv('WAAM_CELL', NAME)
    assert cli.main(['cell', 'new', NAME]) == 0


@contextmanager
def started(
    tmp_path: Path, hidden: dict, steps=(320.0, 320.0, 320.0), without=('scan_fusion', *NO_JOBS)
) -> Iterator[tuple[Path, int]]:
    """The cell as delivered, on its graph: folder and domain."""
    file = tmp_path / 'delivered.yaml'
    file.write_text(yaml.safe_dump({'/**/cell': {'ros__parameters': hidden}}))
    settings = Settings(
        run=tmp_path / 'run', seed=3, machine_steps=steps, params_files=(file,), without=without
    )
    domain = fresh_domain()
    with graph(cell_graph.apply(settings, True).settings, domain, timeout=90.0):
        yield settings.run, domain


def shelf() -> Shelf:
    return Shelf(cell_check.load(cell_check.path_of(NAME)), paths.calibrations_dir())


class WithFile(Hand):
    """Does with its hands what is to be done, and answers from a file."""

    def __init__(self, cell: CommissionedCell, file: Path, worn: Path) -> None:
        self._file = AnswerFile(file)
        super().__init__(cell, 0, worn.with_name('pad_nominal.stl'), worn)

    def ask(self, question: Question) -> str:
        self.asked.append(question.id)
        return self._file.ask(question)


def answers(nominal: Path) -> dict:
    """What a person would read and see at that cell."""
    travel, side, lean = {'x': 400.0, 'y': 300.0, 'z': 200.0}, 150.0, math.tan(math.radians(SKEW))
    said: dict = {
        'signals.current_told': AMPERES, 'signals.voltage_told': VOLTS, 'temperature.told': AMBIENT_C,
        'directions.x': '+x', 'directions.y': '+y', 'directions.z': '+z', 'homing.ends': True, 'gas.flowed': 'opened',
        'skew.diagonals': [math.hypot(side * (1 + lean), side), math.hypot(side * (1 - lean), side)],
        'wire.pieces': [WIRE_MM * WIRE] * 3, 'pyrometer.told': AMBIENT_C + HOTTER_K, 'part.nominal': str(nominal),
    }  # fmt: skip
    for axis, size in travel.items():
        told = [abs(round(share * size)) for share in LENGTHS[axis]]
        said[f'steps.{axis}'] = [length * 320.0 / STEPS[axis] for length in told]
    moved = ('directions', 'homing', 'gas', 'steps', 'skew', 'wire', 'scanner', 'arc', 'lead')
    return said | {f'{step}.ready': True for step in moved}


def test_a_cell_that_is_off_is_led_to_its_first_part(tmp_path, capfd):
    """From the plugged-in board to a part that cleans up, with one start of the graph in between."""
    nominal, worn = write_pad(tmp_path)
    file = tmp_path / 'answers.yaml'
    file.write_text(yaml.safe_dump(answers(nominal)))
    hidden, machine, asked, said = OFF | SCANNER, tuple(STEPS.values()), [], []

    def session() -> int:
        with started(tmp_path, hidden, machine, NOBODY_LOOKS) as (_, domain):
            with CommissionedCell(domain) as cell:
                cell.meet_cell()
                hand = WithFile(cell, file, worn)
                try:
                    return go_on(shelf(), cell, hand, say=said.append)
                finally:
                    asked.extend(hand.asked)

    with pytest.raises(CommissionError, match='step arc: scan_fusion runs with no calibration'):
        session()
    assert session() == 0, said
    book = shelf().book
    found = {name: e.outcome for name, e in book.entries.items()}
    assert book.due() is None and book.state('resonance') == NOT_THERE
    assert book.passed == len(BUILT) - 1 and len(asked) == len(set(asked)) <= 25
    for name, check, true, off in (
        ('skew', 0, SKEW, 0.02),
        ('signals', 0, 1.048, 0.01),
        ('wire', 0, 100 * (1 / WIRE - 1), 0.2),
        ('lead', 0, 1e3 * DELAY_S, 3.0),
        ('lead', 1, 1e3 * LAG_S, 3.0),
        ('scanner', 2, -80.0, 0.5),
    ):
        assert found[name].checks[check].value == pytest.approx(true, abs=off), name
    assert 'cleans up' in found['part'].text
    assert cli.main(['commission', NAME, '--page']) == 0
    text = Path(capfd.readouterr().out.splitlines()[-1]).read_text()
    assert 'This cell is not ready' not in text and text.count('data:image/png') == 3


def test_a_scanner_that_sits_elsewhere_is_found_and_no_arc_burns_before_it_is_used(tmp_path):
    with (
        started(tmp_path, SCANNER, without=NO_JOBS) as (_, domain),
        CommissionedCell(domain) as cell,
    ):
        cell.meet_cell()
        on, hand = shelf(), Hand(cell, 1)
        visit = Visit(BY_NAME['scanner'], cell, hand, on.file, on.kept)
        found = run(visit)
        assert found.passed, found
        burning = Visit(BY_NAME['arc'], cell, hand, on.file, on.kept)
        with pytest.raises(CommissionError, match='step arc: scan_fusion runs with no calibration'):
            run(burning)
    assert hand.asked == ['scanner.ready'], 'nobody is asked for what cannot be done'
    kept = load_calibration(paths.scanner_calibration())
    assert kept.mount_xyz == pytest.approx((0.064, -0.005, 0.124), abs=1e-4)
    assert kept.profile_delay == pytest.approx(-0.08, abs=1e-3)
    up = kept.mounting.rotation[:, 2]
    yaw, pitch, roll = np.radians([2.0, -1.8, 1.9])
    wanted = [
        math.cos(yaw) * math.sin(pitch) * math.cos(roll) + math.sin(yaw) * math.sin(roll),
        math.sin(yaw) * math.sin(pitch) * math.cos(roll) - math.cos(yaw) * math.sin(roll),
    ]
    assert up[:2] == pytest.approx(wanted, abs=2e-3)
    settings = cell_graph.apply(Settings(run=tmp_path / 'again'), True)
    told = yaml.safe_load((tmp_path / 'again' / cell_graph.PARAMETERS).read_text())
    assert told['/**/scan_fusion']['ros__parameters']['calibration'] == str(
        paths.scanner_calibration()
    )
    assert any('as commissioned' in line for line in settings.said)


def test_what_is_connected_wrongly_is_found_each_in_its_step(tmp_path):
    hidden = {
        'delivered_limits': 'bridged', 'delivered_current_scale': -1.0, 'delivered_thermocouple_swapped': True,
        'delivered_xy_swapped': True, 'delivered_gas_valve': 'stuck_closed', 'delivered_skew': 0.5,
    }  # fmt: skip
    with started(tmp_path, hidden) as (_, domain), CommissionedCell(domain) as cell:
        cell.meet_cell()
        hand, on = Hand(cell), shelf()

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
        absent = step('resonance')
        assert not absent.there and 'not known' in absent.text


def test_a_reversed_emergency_stop_ends_the_run_and_keeps_the_gates_closed(tmp_path, capfd):
    answers = tmp_path / 'answers.yaml'
    answers.write_text('nothing.asked: yes\n')
    with started(tmp_path, {'delivered_estop': 'reversed'}) as (folder, domain):
        where = ('--run', str(folder), '--domain', str(domain), '--answers', str(answers))
        assert cli.main(['commission', NAME, *where]) == 1
        said = capfd.readouterr().out
        assert 'the emergency stop is still active' in said and 'reversed' in said
        assert cli.main(['commission', NAME, *where, '--step', 'limits']) == 2
        assert 'limits is not due: estop is failed' in capfd.readouterr().err
        assert cli.main(['commission', NAME, *where, '--step', 'link']) == 0
    book = shelf().book
    assert book.state('estop') == FAILED and book.state('limits') == NOT_DONE
    assert book.state('settings') == 'out of date'


def test_without_cell_file_graph_or_answer_it_says_so(tmp_path, capfd):
    assert cli.main(['commission', 'nobody']) == 2
    assert 'waam cell new nobody' in capfd.readouterr().err
    assert cli.main(['commission', NAME, '--run', str(tmp_path / 'run')]) == 2
    assert 'waam up' in capfd.readouterr().err
    assert cli.main(['commission', NAME, '--step', 'scales']) == 2
    assert 'docs/real_cell.md' in capfd.readouterr().err


def test_one_commissions_a_cell_at_a_time():
    with shelf().alone():
        with pytest.raises(
            CommissionError, match='hidden is being commissioned already by process'
        ):
            with shelf().alone():
                pass
    with shelf().alone():
        pass


def test_answers_are_cleaned_and_what_is_none_is_refused(tmp_path):
    mesh = tmp_path / 'Part.STL'
    mesh.write_text('')
    lengths = Question('steps.x', 'how far?', low=10.0, high=400.0, unit='mm', count=3)
    assert lengths.cleaned(' 79.9, 200.1  320 ') == '79.9 200.1 320'
    assert lengths.wrong('79.9 200.1 320') == '' and lengths.wanted == '3 x mm'
    assert lengths.wrong('79.9 200.1') == '3 numbers from 10 to 400 mm'
    assert lengths.wrong('79.9 200.1 nan') and lengths.wrong('79.9 200.1 x') == '3 numbers'
    part = Question('part.nominal', 'which?', ('no',), file=True)
    assert part.cleaned(f'{mesh} ') == str(mesh) and part.wrong(str(mesh)) == ''
    assert part.cleaned('NO') == 'no' and part.wrong('no') == ''
    assert part.wrong(f'{mesh}.gone') == 'a file that is there, or no'
    file = tmp_path / 'answers.yaml'
    file.write_text(yaml.safe_dump({'steps.x': [79.9, 200.1, 320], 'part.nominal': str(mesh)}))
    assert AnswerFile(file).ask(lengths) == '79.9 200.1 320'
    assert AnswerFile(file).ask(part) == str(mesh)


def test_a_job_that_pauses_is_aborted_once_and_says_why():
    ordered: list[str] = []

    class Client:
        trigger = staticmethod(ordered.append)

    gone = ['']
    paused = Paused(Client, lambda status: None, lambda: gone[0])
    paused.heard(JobStatus(state=JobStatus.DEPOSITING))
    assert paused.look() == '' and ordered == []
    for text in ('paused: no gas', 'paused: something else'):
        paused.heard(JobStatus(state=JobStatus.PAUSED, message=text))
        assert paused.look() == ''
    assert ordered == ['job_sequencer/abort'] and paused.why == 'paused: no gas'
    gone[0] = 'the graph was stopped'
    assert paused.look() == 'the graph was stopped'
