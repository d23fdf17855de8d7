"""What the compiled cores share: parameters and states as records, random numbers that do not depend on threads.

Numba reads a one-element structured array (`record`) by field name, as fast as a C struct; every core takes its
parameters and its state that way. Random numbers come from an explicit state, so that a seed fixes every run.
"""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Callable
from functools import cache
from operator import is_
from pathlib import Path
from typing import Any

import numba
import numpy as np

jit = numba.njit(cache=True, nogil=True)
# For functions that only compiled ones call, and that call into other modules themselves: they are compiled with those,
# so that no stale machine code of them is ever stored.
inner = numba.njit(nogil=True)
STRIDE = np.uint64(0x9E3779B97F4A7C15)  # from one random state to the next


def _sources() -> int:
    """Check sum of the package's code."""
    files = sorted(Path(__file__).parent.glob('*.py'))
    return zlib.crc32(b''.join(f.read_bytes() for f in files))


# Numba notices a change of the file of a cached function, not of the files of the functions it calls. A compiled
# function that calls into other modules is therefore made by a factory that closes over this number: it becomes part of
# the key under which numba stores the function, so stale machine code is never used.
SOURCES = _sources()


@cache
def _floats(names: tuple[str, ...]) -> np.dtype:
    """A record of float64. One object for equal names: numba compares the fields of types that are two objects at every
    call of a compiled function, which takes longer than what most of them do."""
    return np.dtype([(n, np.float64) for n in names])


def record(values: Any) -> np.ndarray:
    """(1,) structured array with the numeric fields of a dataclass as float64, by name."""
    fields = dataclasses.fields(values)
    names = tuple(f.name for f in fields if isinstance(f.default, int | float))
    out = np.zeros(1, _floats(names))
    for n in names:
        out[n] = getattr(values, n)
    return out


def state(*names: str) -> np.ndarray:
    """(1,) structured array of float64 zeros with these fields."""
    return np.zeros(1, _floats(names))


class Settled:
    """A compiled function that is called again and again with the same arrays: numba looks at the types of its
    arguments only when one of them is another array, or of another type, than in the call before. That look is half of
    the time of a call."""

    def __init__(self, function: Any) -> None:
        self._function = function
        self._arrays: tuple[np.ndarray, ...] = ()
        self._kinds: tuple[type, ...] = ()
        self._entry: Callable[..., Any] | None = None

    def __call__(self, arrays: tuple[np.ndarray, ...], *others: Any) -> Any:
        """others: what follows the arrays; an array among them always has the same dtype and layout."""
        kinds = tuple(map(type, others))
        if self._entry is None or kinds != self._kinds or not all(map(is_, arrays, self._arrays)):
            types = tuple(numba.typeof(a) for a in (*arrays, *others))
            self._function.compile(types)
            self._arrays, self._kinds = arrays, kinds
            self._entry = self._function.get_overload(types)
        return self._entry(*arrays, *others)


def random_state(seed: int, *stream: int) -> np.ndarray:
    """(1,) uint64 state of one stream of random numbers, named by whole numbers; those of one seed are independent."""
    return np.random.SeedSequence([seed & 0xFFFFFFFF, *stream]).generate_state(1, np.uint64)


@jit
def mixed(z):
    """A uint64 of which every bit depends on every bit of z (the finaliser of splitmix64)."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@jit
def uniform(rng):
    """Next number in (0, 1) of a (1,) uint64 state (splitmix64, Steele, Lea and Flood 2014)."""
    rng[0] += STRIDE
    return (np.float64(mixed(rng[0]) >> np.uint64(11)) + 0.5) * (1.0 / 9007199254740992.0)


@jit
def normal(rng):
    """Next standard normal number (Box and Muller 1958)."""
    return math.sqrt(-2.0 * math.log(uniform(rng))) * math.cos(2.0 * math.pi * uniform(rng))


@jit
def bilinear(field, origin_x, origin_y, cell, x, y, outside):
    """Value of a (rows, cols) field of cell centres at a point; `outside` beyond the field."""
    u = (x - origin_x) / cell - 0.5
    v = (y - origin_y) / cell - 0.5
    rows, cols = field.shape
    if not (u > -0.5 and v > -0.5 and u < cols - 0.5 and v < rows - 0.5):
        return outside
    u = min(max(u, 0.0), cols - 1.000001)
    v = min(max(v, 0.0), rows - 1.000001)
    c, r = int(u), int(v)
    c1, r1 = min(c + 1, cols - 1), min(r + 1, rows - 1)
    fu, fv = u - c, v - r
    low = field[r, c] * (1.0 - fu) + field[r, c1] * fu
    high = field[r1, c] * (1.0 - fu) + field[r1, c1] * fu
    return low * (1.0 - fv) + high * fv
