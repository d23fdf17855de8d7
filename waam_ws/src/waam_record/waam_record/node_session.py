"""From START to STOP: the taps on the graph and the recording they feed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rclpy.context import Context

from waam_node.params import param

from .bag_writer import BagWriter
from .node_taps import Tap, Taps
from .recording import Limits, Recording


@dataclass(frozen=True)
class RecorderParams:
    directory: str = param(
        '', 'record into this folder from the start; empty = wait for recorder/control'
    )
    exclude: str = param('', 'regular expression; topics it is found in are not recorded')
    poll_period: float = param(
        0.005, 'time between two looks into the subscriptions', 's', 0.001, 0.1
    )
    discovery_period: float = param(1.0, 'time between two looks for new topics', 's', 0.05, 60.0)
    depth: int = param(
        5000, 'messages that the middleware keeps per topic between two looks', '', 10, 100000
    )
    queue_mb: int = param(
        256, 'messages that may wait for the disk; more are dropped and counted', 'MB', 1, 65536
    )
    sync_period: float = param(
        1.0, 'a chunk is closed and synced this often: the loss of a power cut', 's', 0.1, 60.0
    )
    metadata_period: float = param(10.0, 'metadata.yaml is renewed this often', 's', 1.0, 3600.0)
    split_mb: int = param(
        0, 'next file when one is this large; 0 = only on request', 'MB', 0, 1048576
    )
    min_free_mb: int = param(
        200, 'recording ends properly when the disk has less left', 'MB', 0, 1048576
    )
    match_timeout: float = param(
        2.0, 'START waits this long for the known publishers to connect', 's', 0.0, 30.0
    )
    settle: float = param(
        0.25, 'START answers this long after the last one connected', 's', 0.0, 10.0
    )


class Session:
    """One recording of the whole graph. All methods belong to one thread and return at once, `close` excepted.

    simulated: messages are filed under ROS time (`now_ns` of `drain`) instead of their time of arrival.
    """

    def __init__(
        self,
        context: Context,
        directory: Path,
        custom_data: dict[str, str],
        params: RecorderParams,
        simulated: bool,
    ) -> None:
        limits = Limits(
            params.queue_mb << 20,
            params.sync_period,
            params.metadata_period,
            params.split_mb << 20,
            params.min_free_mb << 20,
        )
        self.recording = Recording(BagWriter(directory, custom_data), limits)
        self.taps = Taps(context, params.depth, params.exclude)
        self.paused = False
        self._simulated = simulated
        self.discover()

    def discover(self) -> int:
        """Subscribes to topics that are new in the graph; returns their number."""
        return self.taps.discover_into(self._add)

    def _add(self, tap: Tap) -> None:
        tap.number = self.recording.add_topic(tap.topic)

    def drain(self, now_ns: int) -> None:
        """Hands over what has arrived. now_ns: ROS time, 0 = not known yet."""
        samples = self.taps.drain()
        if self.paused:
            return
        put, simulated = self.recording.put, self._simulated
        for received, tap, data, info in samples:
            log_ns = now_ns if simulated else received
            put(
                tap.number,
                log_ns,
                info['source_timestamp'],
                info['publication_sequence_number'],
                data,
            )

    @property
    def lost(self) -> int:
        """Messages known to be missing: lost on the way, or dropped because the disk did not keep up."""
        return self.taps.lost + sum(self.recording.dropped)

    def stop(self) -> None:
        """Asks for the end; `recording.finished` says when the files are closed and verified."""
        counters = {t.topic.name: t.loss.lost for t in self.taps.taps.values()}
        lost = {f'lost.{name}': str(n) for name, n in counters.items() if n}
        skipped = {f'skipped.{name}': why for name, why in self.taps.skipped.items()}
        self.recording.stop({**lost, **skipped, 'lost': str(self.lost)})

    def summary(self) -> tuple[str, bool]:
        """After `stop`: a sentence, and whether everything is on the disk as it should be."""
        recording = self.recording
        if recording.error:
            return f'recording ended early: {recording.error}', False
        check, wanted = recording.checked, recording.messages
        files = len(recording.writer.files)
        text = f'{wanted} messages of {len(recording.topics)} topics in {files} file(s), {self.lost} lost'
        if check.sound and check.messages == wanted:
            return f'{text}, verified', True
        problems = '; '.join(check.problems) or f'{check.messages} found in the files'
        return f'{text}; verification failed: {problems}', False

    def close(self) -> None:
        self.taps.close()
