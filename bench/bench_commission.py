"""`waam commission` on simulated cells as delivered, over the graph: virtual controller on its pty, cell, DDS.

commission.faults_found: share of the wiring faults that end the wizard in the step that is there for them, before
there is an arc; one that is found is mended and the wizard goes on. Cells with one or two faults, seeds 1, 2, ...
(baseline: what reset and homing alone refuse, the plain procedure without checks).
commission.false_stops: healthy cells, off as delivered, on which a step fails, seeds 51, 52, ... (baseline: none).
commission.parts_in_tolerance: healthy cells whose first part is good: by what truly lies on the table, 99 % of the
needed area at or above nominal, no more than 2 mm on 99 % of it (a small pad, 4 mm deep, finish machined). Baseline:
the same job on the same cell without the wizard.
commission.minutes: of the controller's clock, longest of them. commission.questions: asked of the operator, most.
commission.steps_error_pct, commission.skew_error_deg, commission.scanner_error_mm, commission.scanner_error_deg,
commission.delay_error_ms, commission.lead_error_ms: worst of the healthy cells, found against true (baseline: what the
cell has unless it is commissioned).

WAAM_COMMISSION_CELLS=20,10: how many faulty and healthy ones (default 4,2). A healthy one takes some 6 minutes.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml
from lib.commission_cells import DRAWN_M, FAULTS, LAST_BEFORE_ARC, SCANNER, STEPS, Hidden, drawn
from lib.commission_part import truth
from lib.emit import emit

from waam_bringup import cell_check, cell_graph, paths
from waam_bringup.client import ClientError, GraphClient
from waam_bringup.commission import Shelf, go_on
from waam_bringup.commission_arc import FINISH, Paused
from waam_bringup.commission_cell import CommissionedCell
from waam_bringup.commission_hand import Hand, write_pad
from waam_bringup.graph import Settings
from waam_bringup.operate import graph
from waam_bringup.progress import JobProgress
from waam_calibrate import store
from waam_calibrate.commission import BUILT, CommissionError
from waam_calibrate.results import newest
from waam_msgs.action import RunJob
from waam_node.testing import fresh_domain
from waam_process.cell_file import new
from waam_process.operating import DEFAULT_MATERIAL
from waam_scan.calibration.file import load_calibration

NAME = 'hidden'
SEEN_BY_NOBODY = ('dashboard', 'panel')
NO_JOBS = (
    'scan_fusion', 'correction_server', 'feed_forward', 'thermal_compensator', 'process_control', 'recorder',
    *SEEN_BY_NOBODY,
)  # fmt: skip
PRESET = 'recorded'
PATIENCE_S = 20.0  # for a press that the controller does not see
UPS = 3  # starts of the graph that a whole commissioning may take
BEFORE_ARC = [s.name for s in BUILT[: [s.name for s in BUILT].index(LAST_BEFORE_ARC) + 1]]


@dataclass
class Run:
    """A whole commissioning of a healthy cell. errors: found less true and true less nominal, by figure."""

    stopped: bool = True
    good: bool = False
    good_without: bool = False
    minutes: float = 0.0
    questions: int = 0
    errors: dict[str, tuple[float, float]] = field(default_factory=dict)


UNITS = {
    'steps_error_pct': '%', 'skew_error_deg': 'deg', 'scanner_error_mm': 'mm', 'scanner_error_deg': 'deg',
    'delay_error_ms': 'ms', 'lead_error_ms': 'ms',
}  # fmt: skip


def measure() -> None:
    faulty, healthy = map(int, os.environ.get('WAAM_COMMISSION_CELLS', '4,2').split(','))
    found = plain = total = 0
    for seed in range(1, faulty + 1):
        hidden = drawn(seed, 1 + seed % 2)
        total += len(hidden.faults)
        with folder():
            by_wizard, by_plain = search(hidden)
        found, plain = found + by_wizard, plain + by_plain
    if total:
        share, before = found / total, plain / total
        emit('commission.faults_found', share, '', 'reset and homing alone', before, PRESET)
    runs = [whole(drawn(seed, 0)) for seed in range(51, 51 + healthy)]
    if not runs:
        return
    good, without = sum(r.good for r in runs), sum(r.good_without for r in runs)
    emit(
        'commission.parts_in_tolerance', good, f'of {healthy}', 'not commissioned', without, PRESET
    )
    emit('commission.false_stops', sum(r.stopped for r in runs), 'cells', 'no check', 0, PRESET)
    emit('commission.minutes', max(r.minutes for r in runs), 'min', 'no check', 0, PRESET)
    emit('commission.questions', max(r.questions for r in runs), '', 'no check', 0, PRESET)
    for name, unit in UNITS.items():
        seen = [r.errors[name] for r in runs if name in r.errors]
        worst, had = (max((abs(pair[k]) for pair in seen), default=math.nan) for k in (0, 1))
        emit(f'commission.{name}', worst, unit, 'not commissioned', round(had, 4), PRESET)


def whole(hidden: Hidden) -> Run:
    """The wizard to its end, with as many starts of the graph as it asks for; the part; and the part without it."""
    run = Run()
    with folder() as calibrations:
        nominal, worn = write_pad(calibrations.parent)
        for _ in range(UPS):
            with started(hidden, SEEN_BY_NOBODY) as cell:
                shelf = Shelf(cell_check.load(cell_check.path_of(NAME)), calibrations)
                hand = Hand(cell, hidden.seed, nominal, worn)
                began = cell.fresh(1)[-1].controller_us
                try:
                    run.stopped = bool(go_on(shelf, cell, hand, say=note, patience=PATIENCE_S))
                    again = False
                except CommissionError as e:
                    note(f'refused: {e}')
                    again = True
                run.questions += len(hand.asked)
                run.minutes += (cell.fresh(1)[-1].controller_us - began) / 60e6
                if not again and 'part' in shelf.book.laid:
                    seen = truth(cell)
                    note(f'seed {hidden.seed}: truly {seen}')
                    run.good = seen.good
            if not again:
                break
        run.errors = errors(hidden, calibrations)
        note(f'seed {hidden.seed}: {run}')
    with folder() as calibrations:
        nominal, worn = write_pad(calibrations.parent)
        with started(hidden, SEEN_BY_NOBODY) as cell:
            Hand(cell, hidden.seed, nominal, worn).do('part.place', '', True)
            run.good_without = plainly(cell, nominal)
    return run


def plainly(cell: CommissionedCell, nominal: Path) -> bool:
    """The same job, on the cell as it was delivered."""
    goal = RunJob.Goal(
        name='plain', jobs_dir=str(paths.jobs_dir()), material=DEFAULT_MATERIAL, part=str(nominal), mode='restore',
        loop_mode='closed_loop', plan_settings=[FINISH], fresh=True,
    )  # fmt: skip
    goal.k_gain = goal.layer_height = goal.bead_width = goal.tolerance = math.nan
    with GraphClient(cell.domain) as client, JobProgress(goal.name) as progress:
        paused = Paused(client, progress, lambda: '')
        result = client.run_job(goal, paused.heard, paused.look)
        seen = truth(client)
    note(f'without the wizard: error {result.error_code}, {result.message}; truly {seen}')
    return result.error_code == 0 and seen.good


def errors(hidden: Hidden, calibrations: Path) -> dict[str, tuple[float, float]]:
    """Found less true, and true less nominal, of what was found."""
    kept, p = newest(store.load_all(calibrations).results), hidden.parameters
    found: dict[str, tuple[float, float]] = {}
    steps = [
        (kept[f'steps_{a}'], s)
        for a, s in zip('xyz', hidden.machine_steps, strict=True)
        if f'steps_{a}' in kept
    ]
    if steps:
        off = max(abs(100 * (r.values['steps_per_mm'] / s - 1)) for r, s in steps)
        found['steps_error_pct'] = off, max(abs(100 * (STEPS / s - 1)) for _, s in steps)
    if 'skew' in kept:
        lean = p['delivered_skew']
        found['skew_error_deg'] = kept['skew'].values['y_to_x_deg'] - lean, lean
    if 'lead' in kept:
        true = p['arc_wire_delay'] + p['arc_wire_lag']
        seen = kept['lead'].values['delay_s'] + kept['lead'].values['lag_s']
        found['lead_error_ms'] = 1e3 * (seen - true), 1e3 * true
    if paths.scanner_calibration().is_file():
        m = load_calibration(paths.scanner_calibration()).mounting
        late, drawn_turn = p[SCANNER + 'late'], np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], float)
        at, turn = hidden.scanner_m, hidden.scanner_rotation
        found['scanner_error_mm'] = (
            1e3 * float(np.linalg.norm(m.offset - at)), 1e3 * float(np.linalg.norm(at - DRAWN_M)),
        )  # fmt: skip
        found['scanner_error_deg'] = angle(m.rotation, turn), angle(turn, drawn_turn)
        found['delay_error_ms'] = 1e3 * float(m.delay + late), 1e3 * late
    return found


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """deg between two rotations (3, 3)"""
    return math.degrees(math.acos(min(1.0, max(-1.0, (float(np.trace(a @ b.T)) - 1) / 2))))


def search(hidden: Hidden) -> tuple[int, int]:
    """Faults of a cell that the wizard found, and that the plain procedure did."""
    calibrations, found, plain = paths.calibrations_dir(), 0, 0
    for attempt in range(len(hidden.faults)):
        with started(hidden, NO_JOBS) as cell:
            shelf = Shelf(cell_check.load(cell_check.path_of(NAME)), calibrations)
            hand = Hand(cell, hidden.seed)
            while (due := shelf.book.due()) and due.name in BEFORE_ARC:
                if go_on(shelf, cell, hand, say=note, patience=PATIENCE_S, only=due):
                    break
            if attempt == 0:
                plain = min(refused(cell), len(hidden.faults))
        fault = next((f for f in hidden.faults if due and FAULTS[f][0] == due.name), '')
        if not fault:
            break
        found += 1
        hidden = hidden.mended(fault)
    note(f'seed {hidden.seed}: {found} found, left {hidden.faults}')
    return found, plain


def refused(cell: CommissionedCell) -> int:
    """1 when the machine cannot be reset and homed."""
    try:
        if cell.reset():
            return 1
        cell.home()
    except ClientError:
        return 1
    return 0


def note(text: str) -> None:
    print(f'# {text}', file=sys.stderr, flush=True)


@contextmanager
def folder() -> Iterator[Path]:
    """Folders of their own for a cell; yields that of its calibrations."""
    with tempfile.TemporaryDirectory() as where:
        given = {f'WAAM_{n}': f'{where}/{n.lower()}' for n in ('JOBS', 'CELLS', 'CALIBRATIONS')}
        before = {n: os.environ.get(n) for n in (*given, 'WAAM_CELL')}
        os.environ.update(given, WAAM_CELL=NAME)
        try:
            path = cell_check.path_of(NAME)
            path.parent.mkdir(parents=True)
            path.write_text(new(NAME))
            paths.calibrations_dir().mkdir(parents=True)
            yield paths.calibrations_dir()
        finally:
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.update({name: value})


@contextmanager
def started(hidden: Hidden, without: tuple[str, ...]) -> Iterator[CommissionedCell]:
    """The cell with its graph."""
    with tempfile.TemporaryDirectory() as where:
        file = Path(where) / 'hidden.yaml'
        file.write_text(yaml.safe_dump({'/**/cell': {'ros__parameters': hidden.parameters}}))
        settings = Settings(
            run=Path(where) / 'run', seed=hidden.seed, machine_steps=hidden.machine_steps, params_files=(file,),
            without=without, preset=PRESET,
        )  # fmt: skip
        domain = fresh_domain()
        with (
            graph(cell_graph.apply(settings, True).settings, domain, timeout=120.0),
            CommissionedCell(domain) as cell,
        ):
            cell.meet_cell()
            yield cell


FIGURES = {
    f'commission.{name}': measure
    for name in (
        'faults_found',
        'parts_in_tolerance',
        'false_stops',
        'minutes',
        'questions',
        *UNITS,
    )
}
