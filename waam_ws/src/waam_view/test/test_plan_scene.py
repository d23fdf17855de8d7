"""A plan as a recording, read back with the library's own reader."""

import argparse
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import trimesh
from rerun.chunk import RrdReader

from waam_plan.gcode.store import save_plan
from waam_plan.layers.build import plan_build
from waam_plan.mesh.part import load_part
from waam_plan.plan import Plan
from waam_plan.settings import PlanSettings
from waam_view import blueprint as bp
from waam_view import cli, plan_scene
from waam_view.plan_file import PlanFileError, read_plan
from waam_view.plan_scene import layer_totals, summary, write_recording
from waam_view.viewer import find_recording


@pytest.fixture(scope='module')
def stored(tmp_path_factory) -> tuple[Plan, Path]:
    """A plan with several arc starts a layer, and its file."""
    folder = tmp_path_factory.mktemp('plan')
    two = trimesh.util.concatenate(
        [trimesh.creation.box((25, 20, 6)), trimesh.creation.box((25, 20, 6))]
    )
    two.vertices[8:, 0] += 40
    two.export(folder / 'two.stl')
    plan = plan_build(load_part(folder / 'two.stl'), PlanSettings(lead_on=0.5))
    save_plan(plan, folder / 'plan.npz')
    return plan, folder / 'plan.npz'


@pytest.fixture(scope='module')
def recording(stored) -> dict[str, list[pa.RecordBatch]]:
    """Chunks by entity."""
    return by_entity(stored[1], stored[1].with_name('preview.rrd'))


def by_entity(plan_file: Path, target: Path) -> dict[str, list[pa.RecordBatch]]:
    write_recording(plan_file, target)
    reader = RrdReader(target)
    assert len(reader.recordings()) == 1 and len(reader.blueprints()) == 1
    found: dict[str, list[pa.RecordBatch]] = {}
    for chunk in reader.stream().collect().stream():
        found.setdefault(chunk.entity_path.strip('/'), []).append(chunk.to_record_batch())
    return found


def column(batches: list[pa.RecordBatch], name: str) -> list:
    """Values of the column whose name ends so, row by row."""
    out: list = []
    for batch in batches:
        for field in batch.schema.names:
            if field == name or field.endswith(f':{name}'):
                values = batch.column(field)
                time = pa.types.is_duration(values.type)
                out += (values.cast(pa.int64()) if time else values).to_pylist()
    return out


def seconds(values: list) -> np.ndarray:
    return np.array(values) * 1e-9


def test_all_layers_and_arc_starts_are_there(stored, recording):
    plan, _ = stored
    assert plan.arc_starts > len(plan.layers)
    starts = column(recording[bp.STARTS], 'positions')
    assert len(starts) == plan.arc_starts
    first = [path[0] for layer in plan.layers for path in layer.arc_paths]
    np.testing.assert_allclose(np.array(starts)[:, 0, :2], first, atol=1e-6)
    numbers = [layer.number for layer in plan.layers]
    for entity in (bp.STARTS, bp.BEADS_METAL, bp.BEADS_SPEED, bp.IDLE):
        assert sorted(set(column(recording[entity], bp.LAYERS))) == numbers
    per_layer = np.bincount(column(recording[bp.STARTS], bp.LAYERS))[1:]
    assert per_layer.tolist() == [layer.arc_starts for layer in plan.layers]


def test_beads_are_the_path_with_its_colour_at_its_time(stored, recording):
    plan, _ = stored
    drawn = sum(
        np.linalg.norm(np.diff(np.array(strip), axis=0), axis=1).sum()
        for row in column(recording[bp.BEADS_METAL], 'strips')
        for strip in row
    )
    assert drawn == pytest.approx(plan.length, rel=1e-4)
    width = plan.settings.bead_width
    radii = {r for row in column(recording[bp.BEADS_METAL], 'radii') for r in row}
    assert np.allclose(list(radii), plan_scene.ROD * width)
    last = seconds(column(recording[bp.BEADS_SPEED], bp.PROGRAM_TIME))
    assert (np.diff(last) >= 0).all() and last[-1] < plan.duration
    lit = seconds(column(recording[bp.STARTS], bp.PROGRAM_TIME))
    assert (lit < last[-1]).all() and len(set(lit)) == plan.arc_starts
    metal = {c for row in column(recording[bp.BEADS_METAL], 'colors') for c in row}
    speed = {c for row in column(recording[bp.BEADS_SPEED], 'colors') for c in row}
    assert len(metal) > 1 and len(speed) > 1 and metal != speed
    idle = {c for row in column(recording[bp.IDLE], 'colors') for c in row}
    assert len(idle) == 1 and not idle & (metal | speed)


def test_surfaces_curves_and_words(stored, recording):
    plan, file = stored
    for entity in (bp.FOUND, bp.NOMINAL):
        points = np.array(column(recording[entity], 'vertex_positions')[0])
        wanted = plan.nominal if entity == bp.NOMINAL else plan.as_found
        assert points[:, 2].max() == pytest.approx(np.nanmax(wanted.z), abs=1e-6)
    text = column(recording[bp.PLAN_TEXT], 'text')[0][0]
    assert text == summary(read_plan(file)) and f'{plan.arc_starts} arc starts' in text
    heights = [v[0] for v in column(recording[bp.PLAN_HEIGHT], 'scalars')]
    assert max(h for h in heights if h == h) == pytest.approx(
        max(s.height for layer in plan.layers for s in layer.deposits) * 1e3
    )


def test_totals_are_those_of_the_plan(stored):
    plan, file = stored
    for total, layer in zip(layer_totals(read_plan(file)), plan.layers, strict=True):
        assert (total.layer, total.starts) == (layer.number, layer.arc_starts)
        assert total.length == pytest.approx(layer.length)
        mean = sum(s.length * s.speed for s in layer.deposits) / layer.length
        assert total.speed == pytest.approx(mean)
        burning = sum(s.duration for s in layer.segments if s.arc)
        assert total.burning == pytest.approx(burning) and burning > layer.arc_time
    assert read_plan(file).duration == pytest.approx(plan.duration)


def test_long_programs_are_thinned_but_keep_their_starts(stored, tmp_path, monkeypatch):
    plan, file = stored
    monkeypatch.setattr(plan_scene, 'MAX_POINTS', 100)
    found = by_entity(file, tmp_path / 'preview.rrd')
    points = sum(len(s) for row in column(found[bp.BEADS_METAL], 'strips') for s in row)
    segments = sum(len(layer.segments) for layer in plan.layers)
    assert points < segments / 2
    assert len(column(found[bp.STARTS], 'positions')) == plan.arc_starts


def test_waam_view_opens_a_plan_as_it_is_stored(stored, tmp_path):
    _, file = stored
    (tmp_path / 'plan.npz').write_bytes(file.read_bytes())
    assert find_recording(tmp_path).name == 'plan.npz'
    made = cli._recording([tmp_path], tmp_path / 'view' / 'job.rrd', False)
    assert made.name == 'preview.rrd' and RrdReader(made).recordings()
    (tmp_path / 'preview.rrd').write_bytes(made.read_bytes())
    assert find_recording(tmp_path).name == 'preview.rrd'


@pytest.mark.parametrize('content', [b'', b'not a zip', None])
def test_what_is_no_plan_is_refused_and_leaves_nothing(tmp_path, content, capsys):
    file = tmp_path / 'plan.npz'
    if content is None:
        np.savez(file, z=np.zeros(3))
    else:
        file.write_bytes(content)
    with pytest.raises(PlanFileError, match='not a stored plan'):
        write_recording(file, tmp_path / 'preview.rrd')
    assert [p.name for p in tmp_path.iterdir()] == ['plan.npz']
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers(required=True))
    args = parser.parse_args(['view', str(file)])
    assert args.run_command(args) == 1
    assert 'not a stored plan' in capsys.readouterr().err
