"""A number as the controller reads it: the nearest double up to nine decimals and 15 digits, to 1e-9 beyond."""

from __future__ import annotations

import ctypes
import math

import loop_library
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

LONGEST = 159  # bytes of a line, less its letter
MANY = settings(max_examples=500, deadline=None, derandomize=True, database=None)


class Cursor(ctypes.Structure):
    _fields_ = (
        ('text', ctypes.c_char_p),
        ('length', ctypes.c_size_t),
        ('at', ctypes.c_size_t),
    )


@pytest.fixture(scope='module')
def read():
    """(value, bytes read) of a text; None where the controller finds no number."""
    library = loop_library.load('controller_lib')
    library.waam_read_number.restype = ctypes.c_bool

    def read(text: str) -> tuple[float, int] | None:
        data = text.encode()
        cursor, value = Cursor(data, len(data), 0), ctypes.c_double(math.nan)
        good = library.waam_read_number(ctypes.byref(cursor), ctypes.byref(value))
        return (value.value, cursor.at) if good else None

    return read


def same(read, text: str) -> None:
    expected = float(text)
    got = read(text)
    if abs(int(text.lstrip("+-").partition(".")[0] or "0")) >= 10**9:
        assert got is None
    else:
        digits = text.lstrip('+-0').replace('.', '')
        exact = len(digits) <= 15 and len(text.partition('.')[2]) <= 9
        assert (
            got[0] == expected if exact else abs(got[0] - expected) < 1.1e-9 + 4e-16 * abs(expected)
        ), text
        assert got[1] == len(text)
        assert math.copysign(1.0, got[0]) == math.copysign(1.0, expected)


SIGN = st.sampled_from(['', '-', '+'])
DIGITS = st.text('0123456789', max_size=60) | st.text('0', max_size=40)


@MANY
@given(SIGN, DIGITS, DIGITS, DIGITS)
@example('', '', '0' * 150, '1')
@example('', '000', '9' * 17, '')
@example('-', '0' * 60, '', '0' * 60)
@example('', '999999999', '9' * 60, '')
@example('', '1000000000', '', '')
@example('', '12', '5' + '0' * 60, '')
def test_any_digits(read, sign, whole, first, second):
    """Leading and trailing zeros, point in front or at the end; at 1e9 it is refused."""
    fraction = first + second
    if whole + fraction:
        same(read, f'{sign}{whole}.{fraction}'[:LONGEST])
        same(read, f'{sign}{whole or "0"}')


@MANY
@given(st.floats(-1e9, 1e9, allow_subnormal=False), st.integers(0, 60))
def test_what_python_prints(read, value, digits):
    same(read, f'{value:.{digits}f}')
    if 'e' not in repr(value):
        same(read, repr(value))


@pytest.mark.parametrize(
    'text', ['', '.', '-', '+.', '-.e', 'e5', '--1', '+-1', '1000000000', '1' * 150]
)
def test_no_number(read, text):
    assert read(text) is None


def test_it_ends_where_the_number_ends(read):
    assert read('1e5') == (1.0, 1)
    assert read(' 1.5.5') == (1.5, 4)
    assert read('7-2') == (7.0, 1)
