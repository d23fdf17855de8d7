"""Steps, skew and tool centre point against machines that are made up; poor measurements; results on disk."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_calibrate import measures, report, results, store
from waam_calibrate.evidence import EvidenceError

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


@given(st.floats(0.97, 1.03), st.floats(-0.5, 0.5))
@settings(max_examples=30, deadline=None)
def test_steps_do_not_see_the_play(scale, play) -> None:
    commanded = [50.0, 120.0, 200.0, 280.0]
    found = measures.steps('x', commanded, [scale * c + play for c in commanded], 320.0).values
    assert found['scale'] == pytest.approx(scale, abs=1e-9)
    assert found['offset_mm'] == pytest.approx(play, abs=1e-6)
    assert found['steps_per_mm'] == pytest.approx(320.0 / scale, rel=1e-9)


@pytest.mark.parametrize(
    ('commanded', 'measured', 'text'),
    [
        ([100, 100], [100, 100], 'at least 3'),
        ([10, 10, 10], [10, 10, 10], 'longest travel'),
        ([100, 100, 100], [100, 101, 99], 'scatter'),
        ([100, 100, 100], [80, 80, 80], 'typing error'),
        ([100, 100, 100], [100, 100, -1], 'no length'),
        ([100, 100, 100], [100, 100, 100, 100], 'one for each'),
    ],
)
def test_steps_refuse(commanded, measured, text) -> None:
    with pytest.raises(EvidenceError, match=text):
        measures.steps('x', commanded, measured, 320.0)


@given(st.floats(-3.0, 3.0), st.floats(80.0, 300.0), st.floats(80.0, 300.0))
@settings(max_examples=30, deadline=None)
def test_skew_of_a_frame(angle, x, y) -> None:
    """Corners as a machine whose y axis leans draws them."""
    lean = math.radians(angle)
    top = (y * math.sin(lean), y * math.cos(lean))
    rising, falling = math.hypot(x + top[0], top[1]), math.hypot(top[0] - x, top[1])
    found = measures.skew(x, rising, falling, gauge=0.005).values
    assert found['y_to_x_deg'] == pytest.approx(angle, abs=1e-6)
    assert found['side_y_mm'] == pytest.approx(y, rel=1e-9)
    given = measures.skew(x, rising, falling, y, 0.005).values
    assert given['y_to_x_deg'] == pytest.approx(angle, abs=1e-6)


def test_skew_refuses() -> None:
    for text, lengths in (
        ('no parallelogram', (200.0, 100.0, 100.0)),
        ('diagonal was|was a diagonal', (200.0, 201.0, 201.0)),
        ('too small', (20.0, 28.3, 28.2)),
        ('larger frame', (60.0, 84.9, 84.8)),
        ('lean .7.0 deg: a typing error', (200.0, 299.58, 265.05)),
    ):
        with pytest.raises(EvidenceError, match=text):
            measures.skew(*lengths)
    with pytest.raises(EvidenceError, match='measure again'):
        measures.skew(200.0, 283.0, 282.7, 190.0, 0.01)


def test_tool_point_of_the_source() -> None:
    """delta = t / sin(phi), limit D / (4 sin(phi))."""
    found = measures.tool_point([0.1, 0.12, 0.11], 30.0, 1.2)
    assert found.values == pytest.approx({'offset_mm': 0.22, 'limit_mm': 0.6})
    assert not found.refuses
    assert measures.tool_point([0.4, 0.41, 0.39], 30.0, 1.2).refuses
    for widths, slope, wire in (
        ([0.1, 0.1], 30.0, 1.2),
        ([0.1] * 3, 2.0, 1.2),
        ([0.1] * 3, 30.0, 0.0),
        ([0.1, 3.0, 0.1], 30.0, 1.2),
        ([0.1, -1.0, 0.1], 30.0, 1.2),
    ):
        with pytest.raises(EvidenceError):
            measures.tool_point(widths, slope, wire)


def some() -> results.Result:
    return measures.steps('x', [100.0] * 3, [101.0] * 3, 320.0).of(NOW)


def test_a_result_on_disk(tmp_path) -> None:
    path = store.save(tmp_path, some(), report.page(some()))
    assert store.load(path) == some()
    assert '<h1>Calibration steps_x</h1>' in path.with_suffix('.html').read_text()
    path.write_text(path.read_text().replace('1.01', '1.00'))
    kept = store.load_all(tmp_path)
    assert (
        not kept.results and 'changed by hand' in kept.damaged[0] and path.name in kept.damaged[0]
    )
    assert results.refusals([], kept.damaged)


def test_a_controller_tells_its_settings_by_the_names_that_set_them() -> None:
    """`$L`, and a shaper that it has lost."""
    said = 'shape=zvd:41.40:0.053,none corner_mm=0.02 wire_lag_s=0.065 steps_per_mm_x=320'
    told = results.told_by(said)
    assert (told['shape_x'], told['shape_x_hz'], told['shape_x_damping']) == (2.0, 41.4, 0.053)
    assert told['shape_y'] == 0.0 and told['steps_per_mm_x'] == 320.0
    found = [
        ('shape_x', 0.0),
        ('shape_x_hz', 41.4),
        ('shape_x_damping', 0.053),
        ('shape_x', 2.0),
    ]
    kept = [
        results.Result('resonance', 'x', 'mode', {}, {}, found, date='2026-11-01T10:00:00+00:00')
    ]
    assert results.missing(kept, told) == []
    (lacks,) = results.missing(kept, results.told_by('shape=none,none wire_lag_s=0.065'))
    assert lacks.startswith('resonance_x: shape_x is 0 in the controller, 2 was found')
    for junk in ('shape=', 'shape=zvd', 'shape=new:1:2,none', 'shape=zv:1,none', 'ok', 'a=b=c'):
        assert results.told_by(junk) == {}


def test_status_tells_what_counts_and_what_a_job_refuses() -> None:
    true = measures.steps('x', [100.0] * 3, [100.1] * 3, 320.0).of(NOW + timedelta(days=1))
    told = {'steps_per_mm_x': 320.0}
    refused = results.refusals([some()], [], told)
    assert refused == [
        'steps_x: the controller has 320 steps/mm, 316.832 were found: +1.00 %, at most 0.5 % (waam calibrate apply)'
    ]
    assert not results.refusals([some()], [], {'steps_per_mm_x': 316.832})
    assert not results.refusals([some()]), 'what the controller has is not known'
    assert not results.refusals([true, some()], [], told), 'the newer one counts'
    assert results.missing([true], told) and not results.missing([true], {'steps_per_mm_x': 319.68})
    text = '\n'.join(results.table([some()], [], NOW + timedelta(days=400), told))
    assert 'more than a year ago' in text and 'a job will refuse: steps_x' in text
    assert 'skew         not calibrated' in text


DATA = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=6,
)


@given(st.sampled_from(sorted(results.to_data(some()))), DATA, st.booleans())
@settings(max_examples=150, deadline=None)
def test_a_bad_field_is_refused_never_more(name, value, honest) -> None:
    data = results.to_data(some())
    data[name] = value
    try:
        if honest:
            data['sha256'] = results.digest(data)
        found = results.from_data(data)
    except (results.ResultError, TypeError):
        return
    assert found.name in ('steps_x', 'steps_y', 'steps_z') or name in ('kind', 'axis')


@given(st.text(max_size=200))
@settings(max_examples=60, deadline=None)
def test_any_text_as_a_file(tmp_path_factory, text) -> None:
    path = tmp_path_factory.mktemp('any') / 'x.yaml'
    path.write_text(text)
    with pytest.raises(results.ResultError, match='x.yaml'):
        store.load(path)


def test_any_file_as_samples(tmp_path) -> None:
    (tmp_path / 'a.npz').write_bytes(b'PK nothing')
    with pytest.raises(EvidenceError, match='holds no samples'):
        store.load_samples(tmp_path / 'a.npz')
