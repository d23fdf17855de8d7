"""Names for directions that a calibration does not observe, and what to do about them."""

from __future__ import annotations

import numpy as np

AXES = ('x', 'y', 'z')
PART = 0.2  # share of a direction's largest component from which on another one is mentioned


def unobserved(free: np.ndarray, travelled: np.ndarray, by_motion: bool = True) -> list[str]:
    """The free directions (7, k; position x, y, z, rotation about x, y, z, time offset; in tolerances) in words.

    travelled: (3,) how far the wire tip went along x, y, z; an axis with nearly all of it is 'the travel axis'.
    by_motion: the passes show nothing there; False: the place of the artefact is what is not known.
    """
    return [_words(v, travelled, by_motion) for v in sparse(free)]


def sparse(basis: np.ndarray) -> np.ndarray:
    """(k, 7) vectors that span the columns of basis (7, k), each with a component that no other has (Gauss-Jordan)."""
    rows = np.array(basis.T, float)
    done: list[int] = []
    for i in range(len(rows)):
        left = np.abs(rows[i:])
        left[:, done] = 0.0
        r, c = map(int, np.unravel_index(np.argmax(left), left.shape))
        rows[[i, i + r]] = rows[[i + r, i]]
        rows[i] /= rows[i, c]
        others = np.arange(len(rows)) != i
        rows[others] -= np.outer(rows[others, c], rows[i])
        done.append(c)
    return rows


def axis_name(i: int, travelled: np.ndarray) -> str:
    """The axis, with 'the travel axis' where nearly all of the motion goes."""
    share = travelled[i] / max(float(np.sum(travelled)), 1e-12)
    return f'the travel axis ({AXES[i]})' if share > 0.9 else AXES[i]


def _words(v: np.ndarray, travelled: np.ndarray, by_motion: bool) -> str:
    present = np.abs(v) > PART * np.abs(v).max()
    parts = [f'rotation about {axis_name(i, travelled)}' for i in range(3) if present[3 + i]]
    parts += [f'position along {axis_name(i, travelled)}' for i in range(3) if present[i]]
    if present[6]:
        parts.append('time offset')
    text = ' together with '.join(parts)
    return f'{text} ({_advice(present, by_motion)})'


def _advice(present: np.ndarray, by_motion: bool) -> str:
    if not by_motion:
        return 'it is not known where the artefact stands: touch it off and give position_sigma_mm'
    if present[6] and present[:3].any():
        return 'they cannot be told apart: scan both ways or at two speeds'
    if present[6]:
        return 'the scanner must move while it sees slopes'
    if present[3:6].any():
        return 'add passes across, to both sides and at another height, or an artefact with more surfaces'
    return 'no surface in the scans is inclined that way'
