"""Where metal came from: the parts of an account add up, each finds what it is named after, places are found."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_lab import cli_account, restore, run
from waam_lab.metal_account import PARTS, account, planned_metal, spread, table
from waam_lab.metal_trace import LayerTrace, MetalTrace
from waam_lab.path_places import places
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Segment

SPEC = GridSpec(0.0, 0.0, 4e-4, 80, 120)
WIDTH, SPEED, FEED, HEIGHT = 6e-3, 0.010, 0.06, 2e-3


def segment(a, b, **changes) -> Segment:
    s = Segment(
        0, Kind.DEPOSIT, (*a, 0.0), (*b, 0.0), SPEED, 1, 1, True,
        wire_feed_speed=FEED, height=HEIGHT, width=WIDTH, speed_programmed=SPEED,
    )  # fmt: skip
    return s.at(**changes)


def line(a, b, step=2e-3) -> list[Segment]:
    a, b = np.array(a, float), np.array(b, float)
    n = round(float(np.linalg.norm(b - a)) / step)
    at = a + np.linspace(0, 1, n + 1)[:, None] * (b - a)
    return [segment(p, q) for p, q in zip(at, at[1:], strict=False)]


def zigzag(passes=5, pitch=4e-3, left=0.010, right=0.038, low=0.008) -> list[Segment]:
    out: list[Segment] = []
    for k in range(passes):
        y, ends = low + k * pitch, (left, right) if k % 2 == 0 else (right, left)
        out += line((ends[0], y), (ends[1], y))
        if k + 1 < passes:
            out += line((ends[1], y), (ends[1], y + pitch))
    return out


def traced(segments, feed=1.0, pause=0.0, behind=0.0, width=WIDTH) -> LayerTrace:
    """What a machine without any flaw would leave; feed: factor of the wire on the second half; pause: s at the end."""
    metal = sum(map(planned_metal, segments))
    per_second = metal / sum(s.duration for s in segments)
    rows = []
    way = []
    for s in segments:
        n = round(s.duration / 0.01)
        for t in (np.arange(n) + 0.5) / n:
            way.append(np.array(s.start[:2]) + t * np.subtract(s.end[:2], s.start[:2]))
    way += [way[-1]] * round(pause / 0.01)
    for i, p in enumerate(way):
        share = feed if i >= len(way) / 2 else 1.0
        pool = way[max(0, i - round(behind / SPEED / 0.01))]
        rows.append((*p, 1.0, FEED * share, per_second * 0.01 * share, *pool, width))
    t = LayerTrace(segments, rows, np.zeros(SPEC.shape), None, SPEC)
    at, melt = np.array([r[5:7] for r in rows]), np.array([r[4] for r in rows])
    t.after = spread(at, melt, np.full(len(rows), width), SPEC) / SPEC.resolution**2
    path = np.array(way[: len(way) - round(pause / 0.01)])
    whole = spread(path, np.full(len(path), metal / len(path)), np.full(len(path), WIDTH), SPEC)
    t.planned = HeightGrid(SPEC, whole / SPEC.resolution**2)
    return t


@given(
    st.floats(0.005, 0.040), st.floats(0.005, 0.027), st.floats(2e-3, 9e-3), st.floats(1e-12, 1e-8)
)
def test_spreading_keeps_the_metal(x, y, width, volume):
    laid = spread(np.array([[x, y]]), np.array([volume]), np.array([width]), SPEC)
    assert laid.sum() == pytest.approx(volume, rel=1e-9)
    assert (laid.sum(axis=0) @ SPEC.x) / laid.sum() == pytest.approx(x, abs=1e-6)
    assert (laid.sum(axis=1) @ SPEC.y) / laid.sum() == pytest.approx(y, abs=1e-6)


def test_a_machine_without_flaws_owes_nothing():
    layer = traced(zigzag())
    parts = account(layer).parts
    metal = sum(map(planned_metal, layer.segments))
    for name in PARTS:
        assert np.abs(parts[name]).sum() < 0.03 * metal, name


@pytest.mark.parametrize(
    'flaw, part',
    [
        ({'feed': 0.7}, 'wire'),
        ({'pause': 0.8}, 'motion'),
        ({'behind': 3e-3}, 'trail'),
        ({'width': 8e-3}, 'width'),
    ],
)
def test_each_part_finds_what_it_is_named_after(flaw, part):
    sizes = {k: np.abs(v).sum() for k, v in account(traced(zigzag(), **flaw)).parts.items()}
    others = [v for k, v in sizes.items() if k not in (part, 'setpoint', 'plan')]
    assert sizes[part] > 3 * max(others)


def test_metal_behind_the_torch_is_missing_at_the_end_of_a_bead():
    layer = traced(line((0.010, 0.015), (0.038, 0.015)), behind=3e-3)
    rows = {r.kind: r.metal for r in table(account(layer), places(layer.segments, WIDTH), 3e-3)}
    assert rows['end']['trail'] < -0.2 * rows['end']['wanted']
    assert rows['start']['trail'] > 0.2 * rows['start']['wanted']
    assert abs(rows['elsewhere']['trail']) < 0.05 * rows['elsewhere']['wanted']


def test_places_of_a_zigzag():
    found = places(zigzag(passes=5), WIDTH).of
    assert found['turn'] == pytest.approx(
        np.array([[0.038, 0.010], [0.010, 0.014], [0.038, 0.018], [0.010, 0.022]])
    )
    assert found['gap'] == pytest.approx(np.array([[0.038, 0.014], [0.010, 0.018]]))
    assert len(found['start']) == len(found['end']) == 1 and not len(found['corner'])


def test_places_of_two_beads_with_a_corner():
    way = [*line((0.01, 0.01), (0.03, 0.01)), *line((0.03, 0.01), (0.03, 0.02))]
    idle = segment((0.03, 0.02), (0.01, 0.02), kind=Kind.IDLE, arc=False)
    found = places([*way, idle, *line((0.01, 0.02), (0.02, 0.02))], WIDTH).of
    assert found['corner'] == pytest.approx(np.array([[0.03, 0.01]]))
    assert found['start'] == pytest.approx(np.array([[0.01, 0.01], [0.01, 0.02]]))
    assert found['end'] == pytest.approx(np.array([[0.03, 0.02], [0.02, 0.02]]))
    assert not len(found['turn']) and not len(found['gap'])


def test_a_trace_that_is_not_whole_is_refused():
    with pytest.raises(ValueError, match='not whole'):
        account(LayerTrace(zigzag()))
    layer = traced(zigzag())
    layer.rows.clear()
    with pytest.raises(ValueError, match='no metal was laid'):
        account(layer)


@pytest.fixture(scope='module')
def watched(parts):
    trace = MetalTrace()
    return run(restore(*parts, seed=3, layers=1), trace), trace


def test_a_traced_job_is_the_same_job(watched, parts):
    assert watched[0].rms == run(restore(*parts, seed=3, layers=1)).rms


def test_the_parts_add_up_to_the_metal(watched):
    layer = watched[1].layers[1]
    found = account(layer)
    cell = found.spec.resolution**2
    laid = layer.columns()['melt'].sum()
    assert found.grown.sum() == pytest.approx(laid, rel=0.01)
    assert found.wanted.sum() == pytest.approx(laid, rel=0.15)
    for row in table(found, places(layer.segments, layer.bead_width), 3e-3):
        parts = [row.metal[name] for name in ('wanted', *PARTS)]
        assert sum(parts) == pytest.approx(row.metal['grown'], rel=0.01)
    assert found.grown == pytest.approx((layer.after - layer.before) * cell, abs=1e-15)
    for name in ('trail', 'width', 'flow', 'wire'):  # these move metal only
        assert abs(found.parts[name].sum()) < 0.01 * laid, name


def test_the_verb_tells_places_and_writes_both_files(parts, tmp_path, capsys):
    import argparse

    from waam_lab.cli import register  # the parser of the command line

    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    texts = ['lab', str(parts[0]), '--as-found', str(parts[1]), '--seeds', '3-3', '--layers', '1']
    args = parser.parse_args([*texts, '--account', '--out', str(tmp_path / 'out')])
    assert args.run_command(args) == 0
    told = json.loads((tmp_path / 'out' / 'account.json').read_text())
    assert told['layer'] == 1 and told['seed'] == 3
    for place in (*told['places'].values(), {'mm3': told['whole_mm3']}):
        metal = place['mm3']
        assert sum(metal[k] for k in ('wanted', *PARTS)) == pytest.approx(metal['grown'], rel=0.01)
    assert (tmp_path / 'out' / 'account.png').read_bytes()[:4] == b'\x89PNG'
    assert 'elsewhere' in capsys.readouterr().out


def test_a_layer_that_was_not_laid_is_refused_by_number():
    trace = SimpleNamespace(layers={1: traced(zigzag()), 2: LayerTrace()})
    with pytest.raises(ValueError, match=r'--account 2: the job laid layers 1 to 1'):
        cli_account._chosen(trace, 2)
    assert cli_account._chosen(trace, 0)[0] == 1
