"""Profiles beside the burning arc: what the filter believes, on recorded profiles and on ones whose truth is known."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_process.grid import GridSpec
from waam_scan.fusion.height_map import Fusion
from waam_scan.in_process.profile_filter import ProfileFilter, ProfileLimits
from waam_scan.recordings.files import read_inprocess_csv
from waam_scan.stream.assembler import Assembler
from waam_scan.stream.poses import PoseTrack
from waam_scan.stream.profiles import ProfileBlock
from waam_scan.stream.session import Session
from waam_scan.transform import Mounting

DATA = Path(__file__).parents[5] / 'shared/data/inprocess_profiles'
FAR = 1.5e-3  # m; a point that is off by more is not the bead
X = np.linspace(-0.02, 0.02, 500)


def bead(k: int) -> np.ndarray:
    """A surface with a bead and a step, which moves and rises slowly with the profile number."""
    crown = 2e-3 * np.clip(1 - ((X - 0.003 - 2e-5 * k) / 4e-3) ** 2, 0, None)
    return -0.12 + crown + 1e-5 * k + np.where(X > 0.015, 5e-3, 0.0)


@pytest.mark.skipif(not DATA.exists(), reason=f'{DATA} is absent')
def test_recorded_profiles_lose_their_outliers_and_little_else():
    scan = read_inprocess_csv(next(DATA.glob('*.csv')))
    middle = np.array([np.nanmedian(z) for z in scan.z])
    truth = np.array([np.median(middle[max(0, k - 5) : k + 6]) for k in range(len(middle))])
    off = np.abs(scan.z - truth[:, None])
    kept = np.isfinite(ProfileFilter().block(scan.x, scan.z))
    bad, good = off > FAR, off <= FAR
    assert bad.sum() > 900 and good.sum() > 10_000
    assert (bad & ~kept).sum() >= 0.91 * bad.sum()
    assert (good & kept).sum() >= 0.97 * good.sum()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32))
def test_spatter_glare_and_smoke_go_and_the_surface_stays(seed):
    rng = np.random.default_rng(seed)
    gate, total, wrong, kept_bad, kept_good = ProfileFilter(), 0, 0, 0, 0
    for k in range(60):
        z = bead(k) + 3e-5 * rng.standard_normal(len(X))
        bad = np.zeros(len(X), bool)
        if k > 2:
            for _ in range(rng.integers(0, 4)):  # clusters of up to 30 points, 2 to 9 mm above
                first = rng.integers(0, len(X) - 30)
                bad[first : first + rng.integers(1, 30)] = True
            z[bad] += rng.uniform(2e-3, 9e-3) * rng.choice((-1, 1))
        z[rng.random(len(X)) < 0.3] = np.nan
        keep = gate.keep(X, z)
        seen = np.isfinite(z)
        assert not keep[~seen].any()
        total, wrong = total + int((seen & ~bad).sum()), wrong + int((seen & bad).sum())
        kept_bad += int((keep & bad).sum())
        kept_good += int((keep & ~bad).sum())
    assert kept_bad <= 0.03 * max(wrong, 1)
    assert kept_good >= 0.9 * total
    assert gate.kept == kept_bad + kept_good


def test_a_surface_that_jumps_as_a_whole_is_believed_after_a_while():
    gate = ProfileFilter(ProfileLimits(lost=5))
    assert gate.keep(X, np.full(len(X), -0.12)).all()
    seen = [gate.keep(X, np.full(len(X), -0.10)).all() for _ in range(8)]
    assert seen == [False] * 5 + [True] * 3


def test_points_come_in_any_order_and_distance_or_height_is_the_same():
    rng = np.random.default_rng(1)
    z = bead(0)
    z[100:110] += 4e-3
    order = rng.permutation(len(X))
    for sign in (1, -1):
        a, b = ProfileFilter(), ProfileFilter()
        assert (a.keep(X, sign * z)[order] == b.keep(X[order], sign * z[order])).all()


def test_a_look_holds_what_came_since_the_last_one():
    spec = GridSpec(0.0, 0.0, 0.5e-3, 80, 100)
    mounting = Mounting(np.array([0.0, 0.02, 0.12]))
    track = PoseTrack(1000)
    for k in range(200):
        track.append(k * 10_000_000, 0.02 + k * 1e-4, 0.0, 0.0)
    assembler = Assembler(Fusion(spec, mounting), track)
    session = Session('j', 1, 0, assembler, beside_arc=ProfileFilter())

    def feed(first, last, height):
        stamps = np.arange(first, last, dtype=np.int64) * 10_000_000
        x = np.broadcast_to(X.astype(np.float32), (len(stamps), len(X)))
        session.add(first, ProfileBlock(stamps, x, np.full_like(x, height - 0.12)))

    feed(0, 60, 0.004)
    first = session.look()
    assert np.nanmedian(first.z) == pytest.approx(0.004, abs=1e-5)
    assert np.isnan(session.look().z).all()
    feed(60, 120, 0.004)
    second = session.look()
    seen = [np.isfinite(m.z).any(axis=0) for m in (first, second)]
    assert seen[0].any() and seen[1].any() and (seen[0] & seen[1]).sum() <= 1
