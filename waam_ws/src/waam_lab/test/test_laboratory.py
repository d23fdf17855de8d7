"""Whole jobs in the laboratory: what comes out, that it repeats itself, and how jobs fail. What the loop does is
tested on the cell that scatters least (`QUIET`), the rest on the one that users get."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from waam_job.model.cell import Heat
from waam_job.model.goal import Code, JobError
from waam_job.run.again import Again
from waam_lab import Fault, LabResult, build, over_seeds, restore, run, run_many
from waam_lab.cell import LabCell
from waam_node.params import ParameterError
from waam_process import materials
from waam_process.learned import parse
from waam_sim.faults import Faults
from waam_sim.plant import PlantParams

QUIET = {'preset': 'gentle'}


@pytest.fixture(scope='module')
def taught(tmp_path_factory) -> Path:
    """Folder of what `repaired` has taught."""
    return tmp_path_factory.mktemp('learned')


@pytest.fixture(scope='module')
def repaired(parts, taught) -> LabResult:
    return run(restore(*parts, seed=3, learned=taught, keep_learned=True, **QUIET))


def test_a_worn_block_is_restored(repaired):
    r = repaired
    before = np.sqrt(np.nanmean(r.maps.as_found[r.maps.interior] ** 2))
    assert r.verdict in ('in tolerance', 'out of tolerance')
    assert r.error_code == 0
    assert before > 1.5e-3
    assert r.rms < 0.3e-3
    assert r.layers == len(r.layer_means) >= 2
    assert abs(r.layer_means[-1]) < 0.2e-3
    assert r.rms <= r.largest <= r.max_error
    assert r.rms_edges >= 0.8 * r.rms
    assert 1.0 < r.wire < 30.0
    assert r.time > 60.0
    assert 10.0 < r.scan_time < 0.5 * r.time


def test_the_next_job_starts_with_what_it_taught(parts, repaired, taught):
    (file,) = taught.glob('simulated/*.json')
    kept = parse(file.read_text())
    assert kept.jobs == 1 and kept.layers == repaired.layers - 1
    solver = {
        'correction_server': {'law': 'bead_solver'}
    }  # a network would add what it tells of the layer
    again = run(restore(*parts, seed=3, layers=1, learned=taught, overrides=solver, **QUIET))
    expected = 1 / kept.efficiency
    assert again.reports[0]['flow_factor'] == pytest.approx(expected, rel=1e-3)
    assert parse(file.read_text()) == kept  # it was not to add anything


def test_figures_belong_to_the_maps(repaired):
    error = repaired.maps.error[repaired.maps.interior]
    assert np.sqrt(np.nanmean(error**2)) == pytest.approx(repaired.rms, rel=1e-4)
    share = (np.abs(error) <= 0.2e-3).mean()
    assert share == pytest.approx(repaired.share_in_tolerance, abs=1e-6)


def same(a: LabResult, b: LabResult) -> bool:
    figures = ('rms', 'rms_edges', 'largest', 'time', 'wire', 'layer_means', 'verdict')
    equal = all(getattr(a, name) == getattr(b, name) for name in figures)
    return equal and np.array_equal(a.maps.error, b.maps.error, equal_nan=True)


def test_a_seed_gives_the_same_bits_in_any_number_of_workers(parts, repaired):
    """The job that is the first of its cell is like one that starts fresh (`repaired`, seed 3)."""
    jobs = over_seeds(restore(*parts, **QUIET), [3, 4])
    one, two = run_many(jobs, workers=1), run_many(jobs, workers=2)
    assert [r.seed for r in one] == [3, 4]
    assert same(one[0], repaired)
    assert same(one[0], two[0])
    assert same(one[1], two[1])
    assert not same(one[0], one[1])


def test_closed_loop_beats_open_loop_where_the_process_is_not_as_the_table_says(parts):
    lean = {'cell': {'metal_transfer': 0.72}}
    opened, closed = (
        run(
            restore(
                *parts,
                seed=3,
                strategy='zigzag',
                layer_height=1.2e-3,
                overrides=lean,
                loop_mode=loop_mode,
                **QUIET,
            )
        )
        for loop_mode in ('open_loop', 'closed_loop')
    )
    assert opened.mean < -0.25e-3
    assert closed.rms < 0.8 * opened.rms


def test_a_build_rises_from_the_plate(parts):
    r = run(build(parts[0], seed=2, layers=1))
    assert r.error_code == 0, r.message
    grown = (r.maps.error - r.maps.as_found)[r.maps.interior]
    assert 1e-3 < np.nanmedian(grown) < 4e-3


def test_the_pyrometer_follows_the_metal_of_a_build(parts):
    r = run(build(parts[0], seed=2, layers=2))
    before_second = next(row for row in r.reports if row['layer'] == 2 and not row['final'])
    assert before_second['temperature'] > 60.0


def test_the_interpass_limit_is_that_of_the_material_that_the_job_lays(parts, monkeypatch):
    limits: list[float] = []
    heat = LabCell.heat

    def watched(cell: LabCell) -> Heat:
        found = heat(cell)
        limits.append(found.limit)
        return found

    monkeypatch.setattr(LabCell, 'heat', watched)
    r = run(build(parts[0], seed=2, layers=2, material='316l'))
    assert r.error_code == 0, r.message
    limit = materials.get('316l').interpass_limit
    assert limit < materials.get('er70s-6').interpass_limit
    assert set(limits[-5:]) == {limit}
    temperatures = [row['temperature'] for row in r.reports if not row['final']]
    assert max(temperatures) < limit + 2.0


def test_a_pyrometer_that_looks_beside_the_part_is_doubted_as_in_the_graph(parts):
    beside = {'cell': {'pyrometer_spot_x': 0.09, 'pyrometer_spot_y': 0.07}}
    r = run(build(parts[0], seed=2, layers=2, overrides=beside))
    assert r.error_code == 0, r.message
    assert any('temperature is not believed' in a['text'] for a in r.anomalies)


def test_overrides_act_and_unknown_ones_are_refused_by_name(parts, repaired):
    lean = run(restore(*parts, seed=3, overrides={'cell': {'metal_transfer': 0.6}}, **QUIET))
    assert lean.layer_means[0] < repaired.layer_means[0] - 0.1e-3
    with pytest.raises(ParameterError, match="'correction_server'"):
        run(restore(*parts, overrides={'correction_sever': {'gain': 1.0}}))
    with pytest.raises(ParameterError, match="correction_server: unknown parameter 'gian'.*'gain'"):
        run(restore(*parts, overrides={'correction_server': {'gian': 1.0}}))
    with pytest.raises(
        ParameterError, match="job_sequencer: unknown parameter 'in_layer'; it is gone"
    ):
        run(restore(*parts, overrides={'job_sequencer': {'in_layer': True}}))
    with pytest.raises(ParameterError, match='correction_server.*gain.*limit 1.2'):
        run(restore(*parts, overrides={'correction_server': {'gain': 3.0}}))


def test_another_plant_can_be_put_on_the_table(parts, repaired):
    same_physics = run(restore(*parts, seed=3, plant=PlantParams()))
    assert same(same_physics, repaired)


def test_the_cell_that_users_get_is_restored_too_and_less_evenly(parts, repaired):
    r = run(restore(*parts, seed=3))
    assert r.error_code == 0, r.message
    assert repaired.rms < r.rms < 0.3e-3
    assert r.share_in_tolerance < repaired.share_in_tolerance
    named = run(restore(*parts, seed=3, preset='recorded'))
    assert same(r, named)


def test_a_fault_of_the_cell_ends_the_job_as_in_the_graph(parts, tmp_path):
    job = restore(
        *parts, seed=3, faults=(Fault('gas_loss', 0.0, layer=1),), jobs_dir=tmp_path, keep=True
    )
    r = run(job)
    assert r.verdict == 'failed'
    assert r.error_code == Code.DEPOSITION_FAILED
    assert 'gas' in r.message
    assert any(a['class'] == 'gas' and a['severity'] in ('FAULT', 'ALARM') for a in r.anomalies)
    assert (r.folder / 'report.json').exists()


@pytest.fixture
def later(monkeypatch):
    """The wire ends in the midst of a bead, 8 s after the fault was put in."""
    inject, on = Faults.inject, Faults.on

    def put(self, name, value, now):
        self.began = now
        return inject(self, name, value, now)

    def ends(self, name, now):
        return on(self, name, now) and (name != 'wire_end' or now > self.began + 8.0)

    monkeypatch.setattr(Faults, 'inject', put)
    monkeypatch.setattr(Faults, 'on', ends)


def test_the_end_of_the_wire_costs_a_pause_and_no_bead(parts, repaired, later, monkeypatch):
    """The operator of the laboratory threads new wire and resumes; the arc strikes again where it went out."""
    gaps, lay = [], Again.lay

    def note(self, held, stop):
        gaps.append(self.gap(held))
        lay(self, held, stop)

    monkeypatch.setattr(Again, 'lay', note)
    ended = (Fault('wire_end', 0.0, layer=repaired.layers),)
    r = run(restore(*parts, seed=3, faults=ended, **QUIET))
    assert r.error_code == 0, r.message
    (fault,) = [a for a in r.anomalies if a['severity'] in ('FAULT', 'ALARM')]
    assert fault['class'] == 'wire' and 'job paused' in fault['reaction']
    assert r.layers == repaired.layers and r.rms < 1.3 * repaired.rms
    (gap,) = gaps  # m that the torch had gone without wire
    assert 1e-3 < gap < 5e-3


def test_a_bead_where_no_arc_strikes_costs_a_pause_and_no_job(parts, repaired):
    """Three strikes in vain; the operator of the laboratory cleans the place and resumes."""
    r = run(restore(*parts, seed=3, faults=(Fault('arc_loss', 60.0, layer=2),), **QUIET))
    assert r.error_code == 0, r.message
    (fault,) = [a for a in r.anomalies if a['severity'] in ('FAULT', 'ALARM')]
    assert fault['class'] == 'arc' and 'job paused' in fault['reaction']
    assert r.layers == repaired.layers and r.rms < 1.3 * repaired.rms


def test_wire_that_fails_again_and_again_ends_the_job(parts, monkeypatch):
    monkeypatch.setattr('waam_sim.faults.Faults.on', lambda self, name, now: name == 'wire_end')
    r = run(restore(*parts, seed=3, faults=(Fault('gas_loss', 0.0),)))
    assert r.error_code == Code.ABORTED and 'mended it 5 times' in r.message


def test_a_blind_scanner_is_a_failed_job(parts):
    r = run(restore(*parts, overrides={'cell': {'scanner_dropout': 1.0}}))
    assert r.verdict == 'failed'
    assert r.error_code == Code.SCAN_FAILED


def test_bad_goals_are_refused(parts, tmp_path):
    with pytest.raises(JobError, match='unobtainium'):
        run(restore(*parts, material='unobtainium'))
    with pytest.raises(ValueError, match='worn part'):
        run(restore(parts[0], None))
    with pytest.raises(ValueError, match='no such file'):
        run(restore(parts[0], tmp_path / 'gone.stl'))


def test_what_would_not_act_is_refused(parts):
    with pytest.raises(ValueError, match="unknown fault 'gas_los'"):
        run(restore(*parts, faults=(Fault('gas_los'),)))
    with pytest.raises(ValueError, match="override 'cell.metal_transfer' would not act"):
        overrides = {'cell': {'metal_transfer': 0.8}}
        run(restore(*parts, plant=PlantParams(), overrides=overrides))
    with pytest.raises(ValueError, match='seed is -1'):
        run(restore(*parts, seed=-1))


@pytest.mark.parametrize('machine, node', [('robot', 'bridge'), ('gantry', 'robot_bridge')])
def test_overrides_of_the_other_machines_bridge_are_refused(machine, node):
    job = restore(Path('n.stl'), Path('w.stl'), machine=machine, overrides={node: {}})
    with pytest.raises(ValueError, match=f"overrides of '{node}' do not act"):
        run(job)


def test_a_refused_job_among_many_is_told_and_the_others_go_on(parts):
    good = restore(*parts, seed=3, layers=1)
    bad = restore(*parts, material='unobtainium')
    found = run_many([bad, good], workers=1)
    assert found[0].failed
    assert 'unobtainium' in found[0].message
    assert found[1].error_code == 0


def test_nothing_is_left_behind(parts, tmp_path, monkeypatch):
    made = []

    def mkdtemp(*args, **options) -> str:
        made.append(made_by_library(*args, **options))
        return made[-1]

    made_by_library = tempfile.mkdtemp
    monkeypatch.setattr(tempfile, 'mkdtemp', mkdtemp)
    run(restore(*parts, layers=1, jobs_dir=tmp_path / 'jobs'))
    assert not (tmp_path / 'jobs').exists()
    assert made and not [folder for folder in made if Path(folder).exists()]


@pytest.mark.parametrize('machine', ['gantry', 'robot'])
def test_a_build_that_is_longer_than_the_usual_plate_gets_a_longer_one(tmp_path, machine):
    """A bar of 260 mm; the usual plate ends 220 mm from work zero."""
    file = tmp_path / 'bar.stl'
    trimesh.creation.box(extents=(260, 12, 2)).export(file)
    r = run(build(file, seed=3, layers=1, machine=machine))
    assert r.error_code == 0, r.message
    assert r.maps.spec.extent[1] > 0.26
    assert np.nanmin(r.maps.as_found[r.maps.interior]) > -3.5e-3  # on a plate all the way along
