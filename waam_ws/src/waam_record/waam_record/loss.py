"""Counts messages that a topic's publishers sent and that never arrived, from the publication
sequence numbers."""

from __future__ import annotations


class LossCounter:
    """Losses of one topic.

    Every publisher numbers its messages from 1, but the middleware of this release does not say which publisher a
    message came from. So the numbers are sorted into streams: a number that continues a stream belongs to it; one
    that can begin a stream (not all known publishers heard yet, or not above any stream) begins one; any other is a
    gap of the nearest stream below. Exact for one publisher, and for several as long as losses are rare or their
    numbers far apart; with many losses on a topic of several publishers it is an estimate. What is missing before
    the first message of a publisher, or after its last, cannot be seen.
    """

    def __init__(self) -> None:
        self.lost = 0
        self.received = 0
        self.publishers = 1
        self._last: list[int] = []

    def seen(self, sequence: int) -> None:
        """A message with this publication sequence number was received."""
        self.received += 1
        last = self._last
        if sequence - 1 in last:
            last[last.index(sequence - 1)] = sequence
        elif len(last) < self.publishers or sequence <= min(last):
            last.append(sequence)
        else:
            nearest = max(n for n in last if n < sequence)
            self.lost += sequence - 1 - nearest
            last[last.index(nearest)] = sequence
