"""A layer that is corrected while it is laid, through real processes: seen beside the arc, replaced in the bridge,
recorded, computed again. The wire gives less metal than the material table says, which the first beads show."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from waam_msgs.msg import LayerPlan, LayerReport, SegmentDone
from waam_node.qos import EVENTS, LATCHED
from waam_node.stl import write_worn_block
from waam_process.segment import Kind
from waam_replay.tune import tune

CHANGED = {
    'job_sequencer': {'in_layer': True, 'in_layer_period': 3.0, 'in_layer_preview': 2.0},
    'cell': {'metal_transfer': 0.7},
}


@pytest.fixture(scope='module')
def done(tmp_path_factory, graph_in):
    """A long narrow trough of one layer: its far end is under the scanner while beads begin at the near one."""
    from waam_bringup.client import GraphClient
    from waam_bringup.operate import graph_watch

    folder = tmp_path_factory.mktemp('graph')
    x, y = np.linspace(0, 96, 49), np.linspace(0, 30, 31)
    gx, gy = np.meshgrid(x, y)
    away = np.maximum(np.abs(gx - 48) / 44, np.abs(gy - 15) / 12)
    part = write_worn_block(folder, x, y, 12.0, 2.0 * np.clip(6 * (1 - away), 0, 1))
    file = folder / 'in_layer.yaml'
    file.write_text(yaml.safe_dump({n: {'ros__parameters': p} for n, p in CHANGED.items()}))
    settings = {'params_files': (file,), 'without': ('dashboard', 'panel')}
    plans, reports, ended = [], [], []
    with graph_in(folder, part, **settings) as bench:
        bench.load()
        with GraphClient(bench.domain) as client:
            node = client.node
            node.create_subscription(LayerPlan, 'layer_plan', plans.append, LATCHED)
            node.create_subscription(LayerReport, 'layer_report', reports.append, EVENTS)
            node.create_subscription(SegmentDone, 'segment_done', ended.append, EVENTS)
            goal = bench.goal(layers=1, strategy='zigzag')
            result = client.run_job(goal, lambda _: None, graph_watch(bench.run))
    assert result.error_code == 0, result.message
    return result.job_dir, plans, reports, ended


def test_the_rest_of_the_layer_was_corrected_and_nothing_was_lost(done):
    folder, plans, reports, ended = Path(done[0]), *done[1:]
    report = next(r for r in reports if r.layer == 1 and not r.final)
    assert report.in_layer_corrections >= 1 and report.in_layer_looks >= 2, list(report.reasons)
    assert report.in_layer_segments >= 1 and 0 < report.in_layer_change <= 0.3
    rows = [json.loads(x) for x in (folder / 'in_layer.jsonl').read_text().splitlines()]
    assert len(rows) == report.in_layer_corrections
    layer = [p for p in plans if p.layer == 1]
    before, after = layer[0].segments, layer[-1].segments
    assert [s.index for s in before] == [s.index for s in after]
    other = [b for a, b in zip(before, after, strict=True) if a.speed != b.speed]
    assert other and {s.kind for s in other} == {Kind.DEPOSIT}
    assert min(s.index for s in other) >= min(row['first'] for row in rows)
    assert max(s.speed for s in other) <= 0.02
    indices = [m.index for m in ended]
    assert indices == sorted(set(indices)) and indices[-1] >= after[-1].index


def test_the_record_computes_to_the_same_corrections(done):
    found = tune(Path(done[0]))
    assert all(n == total for n, total in found.identical.values()), found.identical
    assert found.identical['corrections within layers'][1] >= 1
    assert found.identical['setpoints within layers'][1] >= 1
