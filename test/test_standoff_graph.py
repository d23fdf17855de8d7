"""A job with the standoff control switched on, through real processes: settings, topics, record, replay."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

WARPS = {'part_warp': 3.5e-3, 'part_warp_energy': 4e4}


@pytest.fixture(scope='module')
def part(tmp_path_factory, make_part) -> tuple[Path, Path]:
    """A trough with a wide flat bottom, so that its first layer is long."""
    return make_part(tmp_path_factory.mktemp('flat'), depth=2.0, steep=6.0)


@pytest.fixture(scope='module')
def done(tmp_path_factory, part, graph_in):
    """One layer on a part that warps, followed by the laser: the job's folder."""
    folder = tmp_path_factory.mktemp('graph')
    changed = {'bridge': {'standoff_source': 'laser'}, 'cell': WARPS}
    file = folder / 'standoff.yaml'
    file.write_text(yaml.safe_dump({n: {'ros__parameters': p} for n, p in changed.items()}))
    with graph_in(folder, part, params_files=(file,), without=('dashboard', 'panel')) as bench:
        result = bench.job(layers=1)
    assert result.error_code == 0, result.message
    return Path(result.job_dir)


@pytest.fixture(scope='module')
def recorded(done) -> dict[str, list]:
    """Messages of some topics, in the order of the record."""
    from rosbags.highlevel import AnyReader

    found: dict[str, list] = {
        '/standoff': [],
        '/standoff_range': [],
        '/telemetry': [],
        '/layer_plan': [],
    }
    with AnyReader([done / 'record']) as reader:
        wanted = [c for c in reader.connections if c.topic in found]
        for connection, _, raw in reader.messages(connections=wanted):
            found[connection.topic].append(reader.deserialize(raw, connection.msgtype))
    return found


def test_set_measured_and_correction_are_recorded(recorded):
    told = recorded['/standoff']
    assert len(told) > 200
    assert {m.source for m in told} == {1} and {m.alarm for m in told} == {0}
    assert {round(m.set_distance, 4) for m in told} == {0.1}
    correction = np.array([m.correction for m in told])
    assert correction.max() > 1e-3, 'the part rises, and so does the torch'
    assert correction[-1] == 0.0, 'nothing of it is left after the job'
    moved = np.abs(correction) > 0.5e-3
    held = [
        m.measured_distance - m.set_distance
        for m, on in zip(told, moved, strict=True)
        if on and m.known
    ]
    assert np.median(np.abs(held)) < 0.25e-3, (
        'without it, these would be off by half a millimetre and more'
    )


def stamped(messages: list) -> dict[int, object]:
    """Messages by their stamp, ns."""
    return {m.header.stamp.sec * 10**9 + m.header.stamp.nanosec: m for m in messages}


def test_the_range_says_the_same_for_any_tool(recorded):
    told, ranges = stamped(recorded['/standoff']), stamped(recorded['/standoff_range'])
    begin, end = max(min(told), min(ranges)), min(max(told), max(ranges))
    both = {
        t for t in told if begin <= t <= end
    }  # the record begins a little later on one of the topics
    assert len(both) > 200
    assert both == {t for t in ranges if begin <= t <= end}
    for t in both:
        r, m = ranges[t], told[t]
        assert r.range == m.measured_distance or (math.isnan(r.range) and not m.known)


def planned_z(plan, x: float, y: float) -> float:
    """z (m) of the place of the planned beads next to (x, y)."""
    beads = [s for s in plan.segments if s.arc]
    a, b = (
        np.array([(p.x, p.y, p.z) for p in (getattr(s, n) for s in beads)])
        for n in ('start', 'end')
    )
    way = b - a
    along = ((np.array([x, y]) - a[:, :2]) * way[:, :2]).sum(1)
    share = np.clip(along / np.maximum((way[:, :2] ** 2).sum(1), 1e-18), 0, 1)[:, None]
    nearest = a + share * way
    return float(nearest[np.hypot(*(nearest[:, :2] - [x, y]).T).argmin(), 2])


def test_position_less_correction_is_the_programmed_z(recorded):
    (plan,) = recorded['/layer_plan'][-1:]
    frames = {t.controller_us: t for t in recorded['/telemetry'] if t.arc_established}
    near = [(frames.get(m.controller_us - 1000), m.correction) for m in recorded['/standoff']]
    pairs = [(t.position, c) for t, c in near if t is not None and abs(c) > 0.3e-3]
    assert len(pairs) > 50
    off = np.array([p.z - planned_z(plan, p.x, p.y) for p, _ in pairs])
    correction = np.array([c for _, c in pairs])
    assert np.median(np.abs(off)) > 0.3e-3
    assert np.median(np.abs(off - correction)) < 0.03e-3


def test_the_record_is_replayed_to_the_same_maps(done):
    from waam_replay.tune import tune

    again = tune(done)
    assert all(same == total > 0 for same, total in again.identical.values())
