import numpy as np
import pytest

from waam_process.grid import GridSpec
from waam_scan.fusion.height_map import Fusion
from waam_scan.fusion.plausibility import PlausibilityLimits
from waam_scan.stream.poses import PoseTrack
from waam_scan.stream.profiles import ProfileBlock, StampWatch
from waam_scan.stream.session import EndWatch, PreviousMap, Session
from waam_scan.transform import Mounting

MS = 1_000_000
SPEC = GridSpec(0.0, 0.0, 1e-3, 10, 40)
LATERAL = np.linspace(-5e-3, 5e-3, 50)


def started(**options) -> Session:
    mounting = Mounting(np.array([0.0, 0.0, 0.12]), delay=options.pop('delay', 0.0))
    return Session(Fusion(SPEC, mounting), PoseTrack(10_000), **options)


def poses(track: PoseTrack, start_ms: int, end_ms: int, step: int = 10) -> None:
    for t in range(start_ms, end_ms, step):
        track.append(t * MS, t * 1e-5, 5e-3, 10e-3)


def block(start_ms: int, n: int = 10, height: float = 1e-3) -> ProfileBlock:
    stamps = (start_ms + 10 * np.arange(n)) * MS
    x = np.broadcast_to(LATERAL, (n, 50)).astype(np.float32)
    return ProfileBlock(stamps, x, np.full((n, 50), height - 0.13, np.float32))


def test_profiles_wait_for_telemetry_and_are_fused_when_it_comes():
    a = started()
    a.add(block(5))
    assert (a.waiting, a.counts.used) == (10, 0)
    poses(a.track, 0, 60)
    a.resolve()
    assert (a.waiting, a.counts.used) == (5, 5)
    poses(a.track, 60, 200)
    a.resolve()
    assert (a.waiting, a.counts.used) == (0, 10)


def test_what_waits_is_bounded_and_counted():
    a = started(max_waiting=25)
    for k in range(6):
        a.add(block(100 * k))
    assert a.waiting <= 25
    assert a.counts.overflow == 60 - a.waiting


def test_gaps_early_and_late_profiles_are_rejected_not_guessed():
    a = started()
    poses(a.track, 100, 200)
    poses(a.track, 300, 400)
    for start in (55, 155, 255, 355, 455):
        a.add(block(start))
    a.close()
    c = a.counts
    assert c.too_old == 5  # 55 .. 95
    assert c.gap == 11  # 195 .. 295 lies between 190 and 300
    assert c.no_pose == 16  # 395 .. 545
    assert c.overflow == 0
    assert c.used + c.rejected == 50
    text = ' '.join(c.reasons())
    assert 'gap' in text and 'oldest' in text and 'without telemetry' in text


def test_repeated_batches_and_stamps_count_once():
    a = started()
    poses(a.track, 0, 500)
    a.add(block(0))
    a.add(block(0))
    twice = block(200)
    stamps = np.repeat(twice.stamps[:5], 2)
    a.add(ProfileBlock(stamps, twice.x, twice.z))
    assert (a.counts.used, a.counts.repeated) == (15, 15)
    assert a.fusion.profiles == 15


def test_late_batches_are_used_and_give_the_same_map():
    straight, mixed = started(), started()
    for a, order in ((straight, range(8)), (mixed, (3, 0, 7, 1, 2, 6, 5, 4))):
        poses(a.track, 0, 1500)
        for k in order:
            b = block(100 * k, height=1e-3 + 1e-4 * k)
            flip = slice(None, None, -1 if a is mixed else 1)
            a.add(ProfileBlock(b.stamps[flip].copy(), b.x, b.z))
    assert straight.counts.used == mixed.counts.used == 80
    assert straight.counts.out_of_order == 0
    assert mixed.counts.out_of_order == 80 - 2, 'all but the first of batches 3 and 7'
    one, other = straight.fusion.result(), mixed.fusion.result()
    assert one.z.tobytes() == other.z.tobytes()
    assert 'out of order' in ' '.join(mixed.counts.remarks())


def test_a_stamp_that_is_no_longer_remembered_is_not_believed():
    a = started(watch=StampWatch(keep=20))
    poses(a.track, 0, 2000)
    for k in range(5):
        a.add(block(100 * k))
    a.add(block(0))
    assert (a.counts.forgotten, a.counts.used) == (10, 50)
    assert a.counts.untrusted == 10


def test_pauses_between_profiles_are_counted():
    a = started()
    poses(a.track, 0, 2000)
    for start in (0, 100, 540, 640):
        a.add(block(start))
    assert a.counts.breaks == 1
    assert abs(a.counts.longest_break - 0.35) < 1e-9


def test_profiles_of_one_point_and_partial_ones_are_used():
    a = started()
    poses(a.track, 0, 2000)
    stamps = (100 + 10 * np.arange(50)) * MS
    a.add(ProfileBlock(stamps, np.zeros((50, 1), np.float32), np.full((50, 1), -0.129, np.float32)))
    partial = block(700)
    partial.z[:, 5:] = np.nan
    a.add(partial)
    assert a.counts.used == 60 and a.counts.rejected == 0
    m = a.fusion.result()
    assert m.points_used > 0 and a.fusion.dropouts == 10 * 45


def test_profiles_from_before_the_scan_are_stale():
    a = started(not_before_ns=50 * MS)
    poses(a.track, 0, 500)
    a.add(block(0))
    assert (a.counts.stale, a.counts.used) == (5, 5)


def test_the_delay_moves_profiles_along_the_motion():
    plain, late = started(), started(delay=0.1)
    for a in (plain, late):
        poses(a.track, 0, 2000)
        a.add(block(500, n=1))
    column = [int(np.argmax(a.fusion.result().count.sum(axis=0))) for a in (plain, late)]
    assert column[1] - column[0] == 1  # 0.1 s at 10 mm/s = 1 mm


def test_reasons_for_an_empty_map():
    a = started()
    assert a.why_empty() == 'no profiles arrived'
    a.add(block(0, height=np.nan))
    assert 'drop-outs' in a.why_empty()
    a = started()
    a.add(block(0))
    a.close()
    assert 'no profile has a trustworthy pose' in a.why_empty()
    a = started()
    poses(a.track, 0, 500)
    a.add(block(0, height=5.0))
    assert 'outside the grid or the height limits' in a.why_empty()


def test_a_session_is_complete_when_profiles_and_poses_reach_the_end():
    s = started(job_id='a', layer=1)
    s.add_batch(0, block(0))
    s.until_ns = 100 * MS
    assert not s.complete, 'no poses yet'
    poses(s.track, 0, 200)
    s.resolve()
    assert s.complete, 'the last profile is one period before the end'
    s.until_ns = 150 * MS
    assert not s.complete


def test_what_a_scanner_that_never_stops_says_after_the_end_only_shows_that_the_end_is_there():
    s = started(job_id='a', layer=1)
    s.add_batch(0, block(0))
    poses(s.track, 0, 200)
    assert not s.is_past(block(1000)), 'the end is not known yet'
    s.until_ns = 150 * MS
    s.resolve()
    assert not s.is_past(block(100)) and not s.complete
    assert s.is_past(block(160)) and s.complete
    assert s.fresh == s.counts.used == 10 and s.waiting == 0


def test_lost_batches_make_a_map_implausible():
    s = started(job_id='a', layer=1)
    poses(s.track, 0, 2000)
    for k in (0, 1, 5, 6):
        s.add_batch(k, block(100 * k))
    assert s.lost == 3
    s.add_batch(4, block(400))
    assert s.lost == 2, 'a batch that comes late is not lost'
    s.add_batch(6, block(600))
    s.add_batch(7, block(700))
    assert s.lost == 2, 'a batch that comes twice changes nothing'
    s.add_batch(0, block(800))
    s.add_batch(1, block(900))
    assert s.lost == 2, 'a scanner that restarted lost nothing'
    fused = s.close()

    doubts = s.doubts(fused, None, PlausibilityLimits(min_coverage=0.0, max_rejected=0.1))
    assert any('2 of 11 batches' in d for d in doubts)


def test_only_the_same_job_and_grid_is_compared():

    limits = PlausibilityLimits(min_coverage=0.0)
    s = started(job_id='a', layer=1)
    poses(s.track, 0, 5000)
    for k in range(40):
        s.add_batch(k, block(100 * k))
    fused = s.close()
    below = np.full(SPEC.shape, -0.02)
    assert s.doubts(fused, PreviousMap('a', 0, SPEC, below), limits)
    assert not s.doubts(fused, PreviousMap('b', 0, SPEC, below), limits)
    assert not s.doubts(fused, PreviousMap('a', 0, SPEC, np.zeros(SPEC.shape)), limits)
    other = GridSpec(0.0, 0.0, 2e-3, 5, 20)
    assert not s.doubts(fused, PreviousMap('a', 0, other, np.zeros(other.shape)), limits)


def test_waiting_ends_when_nothing_new_comes_or_never_ends():
    watch = EndWatch(until_ns=1000, quiet=1.0, end=30.0, news=0.0, newest_pose_ns=500)
    assert not watch.is_quiet(0.9, 500, last_batch=-5.0)
    assert not watch.is_quiet(1.5, 600, last_batch=-5.0), 'telemetry still comes nearer to the end'
    assert not watch.is_quiet(2.4, 1200, last_batch=-5.0)
    assert watch.is_quiet(2.6, 1300, last_batch=-5.0), 'telemetry past the end is no news'
    assert not watch.is_quiet(2.6, 1300, last_batch=2.0), 'profiles are'
    assert not watch.gives_up(30.0) and watch.gives_up(30.1)


def test_profiles_of_a_lifted_scanner_are_rejected_but_no_reason_to_doubt_the_map():
    s = started(job_id='a', layer=1)
    poses(s.track, 0, 5000)
    for k in range(40):
        s.add_batch(k, block(100 * k, height=np.nan if k < 20 else 1e-3))
    fused = s.close()
    assert s.counts.rejected == 200 and s.counts.untrusted == 0
    assert fused.dropouts == 200 * 50
    assert s.doubts(fused, None, PlausibilityLimits(min_coverage=0.0)) == []


def test_a_scan_may_end_beside_the_part_but_a_blind_scanner_is_noticed():
    """The last second without a return: right where nothing was seen before either, as beside a tall part."""
    limits = PlausibilityLimits(min_coverage=0.0, max_coverage_loss=0.1)
    s = started(job_id='a', layer=1)
    poses(s.track, 0, 5000)
    for k in range(40):
        s.add_batch(k, block(100 * k, height=1e-3 if k < 30 else np.nan))
    s.until_ns = 4000 * MS
    fused = s.close()
    assert 0.1 < fused.coverage < 0.9
    same = PreviousMap('a', 0, SPEC, fused.z)
    assert s.doubts(fused, same, limits) == []
    (late,) = s.doubts(fused, None, limits)
    assert 'the last profile is 1.' in late
    (blind,) = s.doubts(fused, PreviousMap('a', 0, SPEC, np.zeros(SPEC.shape)), limits)
    assert 'coverage fell' in blind
    s.until_ns = 5000 * MS
    (stopped,) = s.doubts(fused, same, limits)
    assert 'the last profile is 1.' in stopped


@pytest.mark.parametrize('end,believed', [(30, True), (24, False)])
def test_a_first_scan_may_end_beside_the_part_as_it_began(end, believed):
    """A second without a return at the beginning; as long at the end, or longer because the scanner went blind."""
    s = started(job_id='a', layer=1)
    poses(s.track, 0, 5000)
    for k in range(40):
        s.add_batch(k, block(100 * k, height=1e-3 if 10 <= k < end else np.nan))
    s.until_ns = 4000 * MS
    doubts = s.doubts(s.close(), None, PlausibilityLimits(min_coverage=0.0))
    assert (doubts == []) == believed


@pytest.mark.parametrize('stops,believed', [(3.0, True), (4.0, False)])
def test_a_first_scan_that_stands_at_its_end_is_judged_by_its_way(stops, believed):
    """Half a second without a return at the beginning, 1.5 s at the end: standing there, or on the way."""
    s = started(job_id='a', layer=1)
    track = s.track
    for t in range(0, 5000, 10):
        track.append(t * MS, min(t * 1e-5, stops * 1e-2), 5e-3, 10e-3)
    for k in range(40):
        s.add_batch(k, block(100 * k, height=1e-3 if 5 <= k < 25 else np.nan))
    s.until_ns = 4000 * MS
    doubts = s.doubts(s.close(), None, PlausibilityLimits(min_coverage=0.0))
    assert (doubts == []) == believed
