"""One recording in progress: a bounded queue, and a thread that writes from it and keeps the disk
at most a second behind."""

from __future__ import annotations

import shutil
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from .bag_reader import Check, check
from .bag_writer import BagWriter, Topic

METADATA_S = 10.0  # metadata.yaml is renewed this often


@dataclass(frozen=True)
class Limits:
    """Limits of a recording on disk."""

    file_bytes: int = 0  # next file above this size; 0 = never
    free_bytes: int = 200 << 20  # recording stops when the disk has less left
    queue_bytes: int = (
        256 << 20
    )  # messages that may wait for the disk; more are dropped and counted
    sync_s: float = 0.8  # a chunk is closed and synced this often: the loss of a power cut


class Recording:
    """`put`, `add_topic`, `split` and `stop` belong to one thread (the node's), the file to the
    writer thread."""

    def __init__(self, writer: BagWriter, limits: Limits = Limits()) -> None:
        self.writer, self.limits = writer, limits
        self.topics: list[Topic] = []
        self.dropped: list[int] = []
        self.error = ''
        self.checked: Check | None = None
        self._queue: deque = deque()
        self._put_bytes = self._written_bytes = 0
        self._untimed: list[tuple] = []
        self._finished = threading.Event()
        self._thread = threading.Thread(target=self._run, name='bag_writer', daemon=True)
        self._thread.start()

    def add_topic(self, topic: Topic) -> int:
        """Number of the topic for `put`."""
        self.topics.append(topic)
        self.dropped.append(0)
        self._queue.append((None, lambda: self.writer.add_topic(topic)))
        return len(self.topics) - 1

    def put(self, topic: int, log_ns: int, publish_ns: int, sequence: int, data: bytes) -> None:
        """Queues a message or, when the queue is full, counts it as dropped. log_ns = 0 means that
        ROS time is not known yet: such messages get the first time that is."""
        if (
            self._put_bytes - self._written_bytes + len(data) > self.limits.queue_bytes
            or self.error
        ):
            self.dropped[topic] += 1
            return
        self._put_bytes += len(data)
        if log_ns == 0:
            self._untimed.append((topic, publish_ns, sequence, data))
            return
        if self._untimed:
            self._give_time(log_ns)
        self._queue.append((topic, log_ns, publish_ns, sequence, data))

    def _give_time(self, log_ns: int | None) -> None:
        for topic, publish_ns, sequence, data in self._untimed:
            at = publish_ns if log_ns is None else log_ns
            self._queue.append((topic, at, publish_ns, sequence, data))
        self._untimed.clear()

    def split(self) -> None:
        """The next file begins after what is queued now."""
        self._queue.append((None, self.writer.split))

    def annotate(self, custom_data: dict[str, str]) -> None:
        """Adds to the custom data of the metadata."""
        self._queue.append((None, lambda: self.writer.custom_data.update(custom_data)))

    def stop(self, custom_data: dict[str, str]) -> None:
        """Asks the thread to write what is queued, close and verify; `finished` says when."""
        self._give_time(None)
        self._queue.append((None, lambda: self._close(custom_data)))

    def _close(self, custom_data: dict[str, str]) -> None:
        dropped = {
            f'dropped.{t.name}': str(n) for t, n in zip(self.topics, self.dropped, strict=True) if n
        }
        self.writer.custom_data.update({**custom_data, **dropped})
        self.writer.close()
        self.checked = check(self.writer.directory)
        self._finished.set()

    @property
    def finished(self) -> bool:
        """The files are closed, or writing has failed (`error`)."""
        return self._finished.is_set()

    def wait(self, timeout: float) -> bool:
        """Waits for the end of `stop`; not for use in a callback."""
        return self._finished.wait(timeout)

    @property
    def messages(self) -> int:
        """Written so far."""
        return self.writer.messages

    @property
    def waiting_bytes(self) -> int:
        """Bytes of the messages that are queued and not written."""
        return self._put_bytes - self._written_bytes

    @property
    def directory(self) -> Path:
        """The folder of the recording."""
        return self.writer.directory

    def _run(self) -> None:
        synced = renewed = time.monotonic()
        try:
            while not self._finished.is_set():
                self._drain(synced + self.limits.sync_s)
                now = time.monotonic()
                if now - synced >= self.limits.sync_s and not self._finished.is_set():
                    self._sync()
                    # counted from its end: a disk that needs longer than that still gets something to write
                    synced = time.monotonic()
                    if now - renewed >= METADATA_S:
                        self.writer.write_metadata()
                        renewed = now
                if not self._queue:
                    time.sleep(0.02)
        except Exception as e:  # whatever failed, the node must learn that recording has ended
            self.error = f'{type(e).__name__}: {e}'
            self._queue.clear()
            with suppress(Exception):  # a full disk refuses this as well
                self.writer.abandon()
            self._finished.set()

    def _drain(self, until: float) -> None:
        """Writes what is queued, in slices, so that a steady flow cannot put off the next sync."""
        queue, write = self._queue, self.writer.write
        while queue and not self._finished.is_set() and time.monotonic() < until:
            for _ in range(min(len(queue), 500)):
                topic, *rest = queue.popleft()
                if topic is None:
                    rest[0]()
                    break
                write(topic, *rest)
                self._written_bytes += len(rest[3])

    def _sync(self) -> None:
        self.writer.flush()
        if 0 < self.limits.file_bytes <= self.writer.file_bytes:
            self.writer.split()
        if shutil.disk_usage(self.writer.directory).free < self.limits.free_bytes:
            self.writer.custom_data['stopped'] = 'disk full'
            self.writer.close()
            free = self.limits.free_bytes / 1e6
            raise OSError(f'less than {free:.0f} MB free on the disk: recording closed')
