"""What jobs have taught: merging that cannot walk away, and a parser that refuses whatever is not whole."""

import json
import math
from dataclasses import asdict, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_process import learned
from waam_process.learned import LIMITS, Learned, LearnedError, Taught, nothing, parse, regime_of

FIRST = nothing('mill', 'er70s-6', 'w600_h200')
JOB = Taught(0.95, 0.02, 6)


def after(jobs: int, efficiency: float = 0.95, lot: str = 'a', start: Learned = FIRST) -> Learned:
    taught = replace(JOB, efficiency=efficiency)
    for i in range(jobs):
        start = start.for_job(lot).after(taught, f'job{i}')
    return start


def test_the_first_job_starts_as_one_without_a_file():
    start = FIRST.for_job('lot 7')
    assert start == replace(FIRST, wire_lot='lot 7')
    assert (start.efficiency, start.efficiency_sigma) == (1.0, 0.15)


def test_one_job_says_nearly_all_and_many_say_it_surely():
    one, many = after(1), after(12)
    assert one.jobs == 1 and one.layers == 6 and one.last_job == 'job0'
    assert one.efficiency == pytest.approx(0.95, abs=2e-3)
    assert many.efficiency == pytest.approx(0.95, abs=1e-4)
    assert many.efficiency_sigma < one.efficiency_sigma


def test_what_people_type_cannot_spoil_the_file():
    odd = nothing('a\n', 'b' * 300, 'c').for_job('lot\t7 é\ud800')
    assert parse(odd.after(JOB, 'j\0').text()).wire_lot == 'lot7 é'


def test_old_jobs_are_forgotten():
    found = after(8, 1.1, start=after(20, 0.9))
    assert found.efficiency == pytest.approx(1.1, abs=0.02)


def test_one_odd_job_moves_the_efficiency_by_less_than_it_is_off():
    known = after(10)
    odd = known.for_job('a').after(replace(JOB, efficiency=0.7), 'odd')
    assert 0.9 < odd.efficiency < known.efficiency


def test_another_lot_of_wire_is_less_certain_and_counts_more():
    known = after(10)
    same, other, untold = (known.for_job(lot) for lot in ('a', 'b', ''))
    assert other.efficiency_sigma > 2 * same.efficiency_sigma and other.weight < same.weight
    assert untold.efficiency_sigma == same.efficiency_sigma and untold.wire_lot == 'a'
    taught = replace(JOB, efficiency=0.88)
    assert other.after(taught, 'j').efficiency < same.after(taught, 'j').efficiency


@given(
    st.lists(
        st.tuples(
            st.floats(allow_nan=True, allow_infinity=True),
            st.floats(0, 10),
            st.sampled_from(['', 'a', 'b']),
        ),
        max_size=30,
    )
)
def test_no_sequence_of_jobs_leads_out_of_the_limits(jobs):
    known = FIRST
    for efficiency, sigma, lot in jobs:
        known = known.for_job(lot).after(Taught(efficiency, sigma, 5), 'job')
        assert parse(known.text()) == known
    for name, (low, high) in LIMITS.items():
        assert low <= getattr(known, name) <= high, name


def test_a_text_is_read_as_it_was_written():
    known = after(3)
    assert parse(known.text()) == known
    assert parse(known.text()).sha256 == json.loads(known.text())['sha256'] == known.sha256


def changed(**fields) -> str:
    """A whole text with other values, and with the hash that fits them."""
    data = {'kind': learned.KIND, 'version': learned.VERSION, **asdict(after(2)), **fields}
    data = {k: v for k, v in data.items() if v != 'gone'}
    return json.dumps({**data, 'sha256': learned._sha256(data)})


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('', 'not JSON'),
        ('{', 'not JSON'),
        ('[1]', 'kind is not'),
        ('{"kind": "other"}', 'kind is not'),
        ('[' * 100_000, 'characters long'),
        ('[' * 60_000, 'not JSON'),
        (changed(version=3), 'version is 3'),
        (changed(efficiency=1.4), 'efficiency is 1.4, must be a number 0.7 .. 1.3'),
        (changed(efficiency=True), 'efficiency is True'),
        (changed(efficiency=None), 'efficiency is None'),
        (changed(weight='gone'), "'weight' is missing"),
        (changed(more=1), "unknown field 'more'"),
        (changed(lag=0.1), "unknown field 'lag'"),
        (changed(jobs=-1), 'jobs is -1'),
        (changed(jobs=1.0), 'jobs is 1.0'),
        (changed(cell='a\n'), 'cell must be a printable text'),
        (changed(weight=0.05).replace('0.05', 'NaN'), 'not JSON'),
        (after(2).text().replace('"jobs": 2', '"jobs": 3'), 'sha256 does not fit'),
    ],
)
def test_what_is_not_whole_is_refused_by_name(text, said):
    with pytest.raises(LearnedError, match=said):
        parse(text)


def test_a_file_of_version_1_is_read_for_its_efficiency():
    old = {
        'layer_noise': 0.015,
        'lag': -0.1,
        'ends': [0.0] * 16,
        'network_weight': 0.8,
        'network': 'ab',
    }
    assert parse(changed(version=1, **old)) == after(2)
    torn = changed(version=1, **old).replace('0.015', '0.016')
    with pytest.raises(LearnedError, match='sha256 does not fit'):
        parse(torn)


@given(st.text(max_size=300))
def test_any_text_is_read_or_refused(text):
    with pytest.raises(LearnedError):
        parse(text)


@given(st.data())
def test_a_damaged_text_is_refused_or_means_the_same(data):
    text = after(2).text()
    at = data.draw(st.integers(0, len(text) - 1))
    cut = data.draw(st.integers(0, 5))
    torn = text[:at] + data.draw(st.text(max_size=5)) + text[at + cut :]
    try:
        assert parse(torn) == after(2)  # white space
    except LearnedError as e:
        assert str(e)


def test_a_regime_is_named_by_bead_and_layer():
    assert regime_of(6e-3, 2e-3) == 'w600_h200'
    assert math.isclose(FIRST.weight, 0.0)
