"""Recordings of rerun that leave nothing behind: it keeps each with its threads, and each layout that is sent to one,
until the process ends. A dashboard draws hundreds of jobs."""

from __future__ import annotations

import os

import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings as native

APPLICATION = 'waam'


def send_layout(recording: rr.RecordingStream, layout: rrb.Blueprint, active: bool = True) -> None:
    """As `RecordingStream.send_blueprint`. active: shown at once, not only after a reset of the layout."""
    stream = rr.RecordingStream._from_native(
        native.new_blueprint(
            application_id=APPLICATION,
            make_default=False,
            make_thread_default=False,
            default_enabled=True,
        )
    )
    stream.set_time('blueprint', sequence=0)
    layout._log_to_stream(stream)
    storage = stream.memory_recording().storage
    native.send_blueprint(storage, active, True, recording=recording.to_native())
    stream.set_sinks(rr.FileSink(os.devnull))  # it and its memory hold each other
    del stream, storage
    native.flush_and_cleanup_orphaned_recordings()


def end(recording: rr.RecordingStream) -> None:
    """Flushes and closes; its file is complete afterwards. Its threads go by `release`, when nobody holds it."""
    recording.flush()
    recording.disconnect()


def release() -> None:
    """Lets go of all recordings that nobody holds any more, and of their threads."""
    native.flush_and_cleanup_orphaned_recordings()
