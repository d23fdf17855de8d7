"""Any text ends as a table or in a refusal that names the file, and what was written comes back."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_record.bag_writer import BagError
from waam_record.foreign import times
from waam_record.foreign.apply import imported
from waam_record.foreign.mapping import read_mapping, written
from waam_record.foreign.propose import propose
from waam_record.foreign.text import Form, read_table

ALPHABET = '0123456789.,;:-+eE \t\r\n"\'abcxyzXIUtime[]{}#/_%µ\x00\ufeffnanNaNinf'


def table(text, form=None):
    return read_table(text.encode() if isinstance(text, str) else text, 'log.csv', form)


def whole(data):
    """Read, proposed, written, read again and imported."""
    found = read_table(data, 'log.csv')
    one = propose(found)
    again = read_mapping(written({'log.csv': one}), 'm.yaml')['log.csv']
    assert again.columns == one.columns and again.form == one.form and again.time == one.time
    made = imported(found, again, 'log.csv', 'log')
    assert made.told and all(list(c.messages) for c in made.columns)


@settings(max_examples=400, deadline=None)
@given(st.text(alphabet=ALPHABET, max_size=400))
def test_any_text_is_a_table_or_a_named_refusal(text):
    try:
        whole(text.encode())
    except BagError as e:
        assert str(e).startswith('log.csv') and '\n' not in str(e)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=300))
def test_any_bytes_too(data):
    try:
        whole(data)
    except BagError as e:
        assert str(e).startswith('log.csv')


SHAPED = (
    'time,x,I,note\n36:51.1,1.5,120,a\n36:51.2,2.5,121,b\r\n36:51.3,3.5,122,c\r36:51.4,,nan,d\n'
)


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.integers(0, len(SHAPED)), st.text(ALPHABET, max_size=3)), max_size=6))
def test_a_damaged_log_is_read_or_refused(changes):
    text = SHAPED
    for at, put in changes:
        text = text[:at] + put + text[at + 1 :]
    try:
        whole(text.encode())
    except BagError as e:
        assert str(e).startswith('log.csv')


NUMBERS = st.decimals(-9999, 9999, allow_nan=False, places=3)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.lists(NUMBERS, min_size=3, max_size=3), min_size=6, max_size=20),
    st.sampled_from(['\n', '\r\n', '\r', '\r\n\r\n', '\n\n']),
    st.sampled_from([('tab', '\t', '.'), (';', ';', ','), (',', ',', '.'), ('tab', '\t', ','), ('blank', '  ', ',')]),
    st.sampled_from(['utf-8', 'utf-8-sig', 'utf-16', 'latin-1']),
    st.lists(st.sampled_from(['[Device][1.1]', 'Measured by hand', '']), max_size=2),
)  # fmt: skip
def test_what_was_written_comes_back(rows, end, way, encoding, above):
    name, sign, decimal = way
    lines = [*above, sign.join(['a', 'b', 'c'])]
    lines += [sign.join(str(v).replace('.', decimal) for v in row) for row in rows]
    found = read_table((end.join(lines) + end).encode(encoding), 'log.csv')
    assert found.form.delimiter == name and found.head == ['a', 'b', 'c'] and not found.skipped
    back = [[float(c.replace(',', '.')) for c in cells] for _, cells in found.rows]
    assert back == [[float(v) for v in row] for row in rows]
    assert found.form.decimal == decimal


def test_lines_keep_their_numbers_and_wrong_ones_are_named():
    found = table('a;b\r\r\n1,5;2,5\r7,5\n\n3,5;4,5\n')
    assert found.form == Form(';', ',', 1)
    assert [n for n, _ in found.rows] == [3, 6]
    assert found.skipped == [(4, '1 cells, the header has 2')]


@pytest.mark.parametrize(
    ('text', 'word'),
    [
        ('', 'header and one row'),
        ('time', 'header and one row'),
        ('one two\nthree\nfour five six\n', 'no table'),
        (b'time,x\n1,2\n\x00\x01', 'line 3: holds zero bytes'),
        ('X,Y\n1,5,3,7\n2,5,4,7\n', 'decimal commas'),
        (b'\xff\xfe\x00\xd8', 'UTF-16'),
    ],
)
def test_what_is_no_table_is_refused_by_name(text, word):
    with pytest.raises(BagError, match=word) as e:
        table(text)
    assert str(e.value).startswith('log.csv')


def test_names_that_stand_twice_and_none():
    found = table('x,x,,\n1,2,3,4\n')
    assert found.head == ['x', 'x (2)', 'column_3', 'column_4']
    assert table('1,2\n3,4\n').head == ['column_1', 'column_2']


@pytest.mark.parametrize(
    ('text', 'form', 'ns'),
    [
        ('36:51.1', 'minute_second', 2211_100_000_000),
        ('2022/10/21/16:48:38.51', 'year_first', 1666370918_510_000_000),
        ('2025-04-15 17:36:53.860', 'year_first', 1744738613_860_000_000),
        ('2025-04-15T19:36:53+02:00', 'year_first', 1744738613_000_000_000),
        ('15.04.2025 17:36:53,5', 'day_first', 1744738613_500_000_000),
        ('04/15/2025 17:36', 'month_first', 1744738560_000_000_000),
        ('00:01:02,0300', 'clock', 62_030_000_000),
        ('1666985301185212971', 'ns', 1666985301_185212971),
        ('1,5', 's', 1_500_000_000),
        ('-2889.998', 's', -2889_998_000_000),
    ],
)
def test_times_of_others(text, form, ns):
    assert times.reader(form)(text) == ns
    assert times.guess([text] * 5, 'time_s')[0] == form


@pytest.mark.parametrize(
    'text', ['61:00.0', '12:60', 'inf', 'nan', '1_000', '1e400', '2022/13/01/10:00', '٣:١']
)
def test_times_that_are_none(text):
    for form in times.FORMATS:
        with pytest.raises((ValueError, OverflowError)):
            times.reader(form)(text)


@given(st.lists(st.integers(1, 30_000), min_size=2, max_size=200), st.integers(0, 3_599_999))
def test_minutes_go_on_past_the_hour(steps, start):
    true = [start]
    for step in steps:
        true.append(true[-1] + step)
    seen = [f'{t // 60_000 % 60:02d}:{t % 60_000 / 1000:06.3f}' for t in true]
    stamps = times.unwrapped(
        [times.reader('minute_second')(s) for s in seen], times.WRAPS['minute_second']
    )
    assert [b - a for a, b in zip(stamps, stamps[1:], strict=False)] == [s * 10**6 for s in steps]


@given(st.lists(st.integers(1, 5), min_size=2, max_size=60))
def test_truncated_stamps_are_spread_and_never_go_back(counts):
    stamps = [k * 100 for k, n in enumerate(counts) for _ in range(n)]
    out, moved = times.spread(stamps)
    assert moved == len(stamps) - len(set(stamps))
    assert out == sorted(out) and len(set(out)) == len(out)
    assert all(
        b == a for k, (a, b) in enumerate(zip(stamps, out, strict=True)) if a not in stamps[:k]
    )
    assert times.spread([0, 0, 100, 100, 300, 300])[0] == [0, 50, 100, 150, 300, 350]


@settings(max_examples=200, deadline=None)
@given(st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(
        ['time', 'columns', 'delimiter', 'decimal', 'is', 'unit', 'column', 'format', 'start', 'rate_hz', 'travel']
    ), inner, max_size=4), max_leaves=12,
))  # fmt: skip
def test_any_mapping_is_read_or_refused_by_name(value):
    import yaml

    text = yaml.safe_dump({'waam_import': 1, 'files': {'a.csv': value}})
    try:
        read_mapping(text, 'm.yaml')
    except BagError as e:
        assert str(e).startswith('m.yaml')


def test_number_is_strict():
    from waam_record.foreign.text import number

    assert number(' 1,5 ', ',') == 1.5 and number('-2e3', '.') == -2000.0
    for text, decimal in (
        ('1.234,5', ','),
        ('1,5', '.'),
        ('1_0', '.'),
        ('inf', '.'),
        ('', '.'),
        ('0x1', '.'),
    ):
        assert math.isnan(number(text, decimal))
