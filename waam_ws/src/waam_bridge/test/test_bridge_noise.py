"""The bridge core and the real controller core over a bad cable: executed as sent, or held with a reason and no arc."""

import random

import pytest
from bridge_cable import Cable
from bridge_campaign import ACCEL, SCALE, SHAPER, Campaign, Path, steps
from controller_lib import ControllerLib

from waam_bridge import frames


def test_the_cable_makes_the_faults_that_it_promises():
    cable = Cable(random.Random(1), 1e-3)
    sent = bytes(range(256)) * 400
    cable.send(sent)
    portions = [cable.receive() for _ in range(200)]
    lost, doubled = cable.faults['lost'], cable.faults['doubled']
    assert len(b''.join(portions)) == len(sent) - lost + doubled
    assert all(60 < count < 150 for count in cable.faults.values())
    cable = Cable(random.Random(2), 0.0)
    cut = 0
    for _ in range(100):
        cable.send(sent[:50])
        cut += len(cable.receive()) != 50
    assert cut > 5  # in other portions than it was sent in


@pytest.mark.parametrize('shift', [1, -1])
def test_the_campaign_would_notice_a_line_that_is_skipped_or_executed_twice(shift):
    """The judge is the controller's own record of executed blocks; here its expectation is shifted by one."""
    campaign = Campaign(300, seed=1, rate=0.0, rough=False)

    def disturb(done: int) -> None:
        if done == 40 and len(campaign.waiting) > 100:
            campaign.waiting.rotate(shift)

    report = campaign.run(disturb)
    assert report.third and 'ended at' in report.third[0]


def test_over_a_good_cable_nothing_is_sent_twice():
    report = Campaign(800, seed=2, rate=0.0, rough=False).run()
    assert report.third == [] and report.segments == 800
    assert report.resends == report.bad_frames == 0 and report.holds == {}


@pytest.mark.parametrize(
    ('rate', 'segments', 'seed', 'settings'),
    [
        (1e-4, 4000, 3, ()),
        (1e-3, 1500, 4, ()),
        (3e-3, 600, 5, ()),
        (1e-3, 1000, 6, SHAPER),
        (1e-3, 1000, 7, SHAPER + SCALE + ACCEL),
    ],
)
def test_there_is_no_third_outcome(rate, segments, seed, settings):
    report = Campaign(segments, seed, rate, settings=settings).run()
    assert report.third == []
    assert report.segments == segments
    assert report.bad_frames > 0 and report.resends > 0 and min(report.faults.values()) > 0
    assert report.arc_off_max_ms <= 500.0


def test_positions_are_what_the_controller_rounds_to():
    path = Path(1)
    ends = [steps(path.segment(i)) for i in range(200)]
    assert all(a != b for a, b in zip(ends, ends[1:], strict=False))


def doubled(line: bytes, at: int) -> bytes:
    return line[:at] + line[at : at + 1] + line[at:]


def test_a_doubled_byte_that_a_crc16_misses_is_caught_by_the_crc32():
    """Found by trying: about one in 65 000. The controller takes the one for what was sent, and refuses the other."""
    lines = (b'N1 G4 P%d.%04d' % (n % 90, n) for n in range(1, 9000))
    places = ((line, at) for line in lines for at in range(6, len(line)))
    line, at = next(p for p in places if frames.check(doubled(*p)) == frames.check(p[0]))
    for digits, answer in ((frames.CRC16, b'ok N1 '), (frames.CRC32, b'rs N1 E100')):
        controller = ControllerLib(5)
        controller.feed(
            frames.immediate('I', 'keep', 0, digits) + frames.immediate('L', '1', 0, digits)
        )
        sealed = frames.seal(line, digits)
        controller.feed(doubled(sealed, at))
        assert answer in controller.take()
        controller.close()
