"""From START to STOP: the taps on the graph and the recording they feed."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rclpy.context import Context

from waam_node.params import param

from .bag_writer import BagError, BagWriter
from .choice import Choice
from .node_parameters import ParameterReader
from .node_taps import Tap, Taps
from .provenance import job_files, versions
from .recording import Limits, Recording


@dataclass(frozen=True)
class RecorderParams:
    """Parameters of the node, with default, meaning, unit and limits."""

    exclude: str = param('', 'regular expression; topics it is found in are not recorded')
    split_mb: int = param(2048, 'next file when one is this large; 0 = never', 'MB', 0, 1048576)
    min_free_mb: int = param(
        200, 'recording ends properly when the disk has less left', 'MB', 0, 1048576
    )


class Session:
    """One recording of the graph, which begins with `discover`. All methods belong to one thread, which is not the one
    of the node's executor.

    simulated: messages are filed under ROS time (`now_ns` of `drain`) instead of their time of arrival;
    on_progress: is called after every subscription. namespace: of the cell, whose topics and nodes are recorded.
    """

    def __init__(
        self,
        context: Context,
        directory: Path,
        custom_data: dict[str, str],
        params: RecorderParams,
        simulated: bool,
        on_progress: Callable[[], None] = lambda: None,
        namespace: str = '/',
    ) -> None:
        limits = Limits(params.split_mb << 20, params.min_free_mb << 20)
        require_space(directory, limits.free_bytes)
        writer = BagWriter(directory, {**versions(), **job_files(directory), **custom_data})
        self.recording = Recording(writer, limits)
        self.taps = Taps(context, Choice(params.exclude, namespace))
        self.parameters = ParameterReader(context, namespace)
        self.paused = False
        self._simulated, self._on_progress = simulated, on_progress
        self._noted: dict[str, str] = {}

    @property
    def directory(self) -> Path:
        """The folder of the recording."""
        return self.recording.directory

    def discover(self) -> int:
        """Subscribes to topics that are new in the graph, asks nodes for their parameters, and notes losses; returns
        the number of new topics."""
        self._note(self.parameters.read() | self._loss_notes())
        return self.taps.discover_into(self._add)

    def _note(self, custom_data: dict[str, str]) -> None:
        if new := {k: v for k, v in custom_data.items() if self._noted.get(k) != v}:
            self._noted |= new
            self.recording.annotate(new)

    def _loss_notes(self) -> dict[str, str]:
        return {f'lost.{name}': str(n) for name, n in self.taps.losses().items()}

    def _add(self, tap: Tap) -> None:
        tap.number = self.recording.add_topic(tap.topic)
        self._on_progress()

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

    def losses(self) -> dict[str, str]:
        """'lost <topic>' and 'dropped <topic>' with their counts, for the diagnostics."""
        found = {f'lost {name}': str(n) for name, n in self.taps.losses().items()}
        pairs = zip(self.recording.topics, self.recording.dropped, strict=True)
        return found | {f'dropped {t.name}': str(n) for t, n in pairs if n}

    def stop(self, why: str = '') -> None:
        """Asks for the end; `recording.finished` is set once the files are closed and verified. why: it ends without
        STOP."""
        ended = {'ended': why} if why else {}
        skipped = {f'skipped.{name}': why for name, why in self.taps.skipped.items()}
        files = job_files(self.recording.writer.directory)
        lost = {**self._loss_notes(), 'lost': str(self.lost)}
        self.recording.stop({**files, **lost, **skipped, **ended})

    def summary(self) -> tuple[str, bool]:
        """After `stop`: a sentence, and whether everything is on the disk as it should be."""
        recording = self.recording
        if recording.error:
            return f'recording ended early: {recording.error}', False
        check, wanted = recording.checked, recording.messages
        if check is None:
            waiting = recording.waiting_bytes / 1e6
            return (
                f'{recording.directory} is not closed yet, {waiting:.1f} MB wait for the disk',
                False,
            )
        files = len(recording.writer.files)
        text = f'{wanted} messages of {len(recording.topics)} topics in {files} file(s), {self.lost} lost'
        if check.sound and check.messages == wanted:
            return f'{text}, verified', True
        problems = '; '.join(check.problems) or f'{check.messages} found in the files'
        return f'{text}; verification failed: {problems}', False

    def close(self) -> None:
        """Gives the subscriptions up; the recording itself ends with `stop`."""
        self.parameters.close()
        self.taps.close()


def require_space(directory: Path, free_bytes: int) -> None:
    """BagError when the disk that will hold the folder has less free space."""
    parent = next(p for p in Path(directory).resolve().parents if p.exists())
    if (free := shutil.disk_usage(parent).free) < free_bytes:
        raise BagError(
            f'{parent}: {free / 1e6:.0f} MB free, recording needs at least {free_bytes / 1e6:.0f} MB'
        )
