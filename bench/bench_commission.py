"""`waam commission` on simulated cells as delivered, over the graph: virtual controller on its pty, cell, DDS.

commission.faults_found: share of the wiring faults that end the wizard in the step that is there for them, before
there is an arc; one that is found is mended and the wizard goes on. Cells with one or two faults, seeds 1, 2, ...
(baseline: what reset and homing alone refuse, the plain procedure without checks).
commission.false_stops: healthy cells, off as delivered, on which a step fails, seeds 51, 52, ... (baseline: none).
commission.questions: asked of the operator on a healthy cell.
commission.steps_error_pct, commission.skew_error_deg: worst of the healthy cells, found against true (baseline: what
the cell has unless it is commissioned).

WAAM_COMMISSION_CELLS=20,10: how many faulty and healthy ones (default 4,2).
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml
from lib.commission_cells import FAULTS, STEPS, Hidden, drawn
from lib.emit import emit

from waam_bringup import cell_check, cell_graph, paths
from waam_bringup.client import ClientError
from waam_bringup.commission import Shelf, go_on
from waam_bringup.commission_cell import CommissionedCell
from waam_bringup.commission_hand import Hand
from waam_bringup.graph import Settings
from waam_bringup.operate import graph
from waam_node.testing import fresh_domain
from waam_process.cell_file import new

NAME = 'hidden'
NOT_NEEDED = (
    'scan_fusion', 'correction_server', 'feed_forward', 'thermal_compensator', 'process_control', 'recorder',
    'dashboard', 'panel',
)  # fmt: skip
PRESET = 'recorded'
PATIENCE_S = 20.0  # for a press that the controller does not see


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
        emit(
            'commission.faults_found',
            found / total,
            '',
            'reset and homing alone',
            plain / total,
            PRESET,
        )
    stops, questions, steps, skews, before, lean = 0, 0, [0.0], [0.0], [0.0], [0.0]
    for seed in range(51, 51 + healthy):
        hidden = drawn(seed, 0)
        with folder() as calibrations, started(hidden) as cell:
            shelf, hand = (
                Shelf(cell_check.load(cell_check.path_of(NAME)), calibrations),
                Hand(cell, seed),
            )
            stops += go_on(shelf, cell, hand, say=note, patience=PATIENCE_S)
            questions = max(questions, len(hand.asked))
            found_now = {
                name: e.outcome for name, e in shelf.book.entries.items() if e.outcome.passed
            }
        if 'steps' in found_now:
            scales = [c.value for c in found_now['steps'].checks]
            true = [STEPS / s for s in hidden.machine_steps]
            steps += [100 * abs(f / t - 1) for f, t in zip(scales, true, strict=True)]
            before += [100 * abs(t - 1) for t in true]
        if 'skew' in found_now:
            skew = hidden.parameters['delivered_skew']
            skews.append(abs(found_now['skew'].checks[0].value - skew))
            lean.append(abs(skew))
    if healthy:
        emit('commission.false_stops', stops, 'cells', 'no check', 0, PRESET)
        emit('commission.questions', questions, '', 'no check', 0, PRESET)
        emit(
            'commission.steps_error_pct',
            max(steps),
            '%',
            'not commissioned',
            round(max(before), 4),
            PRESET,
        )
        emit(
            'commission.skew_error_deg',
            max(skews),
            'deg',
            'not commissioned',
            round(max(lean), 4),
            PRESET,
        )


def search(hidden: Hidden) -> tuple[int, int]:
    """Faults of a cell that the wizard found, and that the plain procedure did."""
    calibrations, found, plain = paths.calibrations_dir(), 0, 0
    for attempt in range(1 + len(hidden.faults)):
        with started(hidden) as cell:
            shelf = Shelf(cell_check.load(cell_check.path_of(NAME)), calibrations)
            status = go_on(shelf, cell, Hand(cell, hidden.seed), say=note, patience=PATIENCE_S)
            if attempt == 0:
                plain = min(refused(cell), len(hidden.faults))
        due = shelf.book.due()
        fault = next((f for f in hidden.faults if due and FAULTS[f][0] == due.name), '')
        if not status or not fault:
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
            yield paths.calibrations_dir()
        finally:
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.update({name: value})


@contextmanager
def started(hidden: Hidden) -> Iterator[CommissionedCell]:
    """The cell with its graph."""
    with tempfile.TemporaryDirectory() as where:
        file = Path(where) / 'hidden.yaml'
        file.write_text(yaml.safe_dump({'/**/cell': {'ros__parameters': hidden.parameters}}))
        settings = Settings(
            run=Path(where) / 'run', seed=hidden.seed, machine_steps=hidden.machine_steps, params_files=(file,),
            without=NOT_NEEDED, preset=PRESET,
        )  # fmt: skip
        domain = fresh_domain()
        with (
            graph(cell_graph.apply(settings, True).settings, domain, timeout=90.0),
            CommissionedCell(domain) as cell,
        ):
            yield cell


FIGURES = {
    f'commission.{name}': measure
    for name in ('faults_found', 'false_stops', 'questions', 'steps_error_pct', 'skew_error_deg')
}
