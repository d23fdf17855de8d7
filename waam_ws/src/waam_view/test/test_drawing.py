"""The drawing thread never holds anybody up; layout and recordings are as named."""

import dataclasses
import os
import re
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import yaml

from waam_process.grid import GridSpec
from waam_process.unrolled import OVERLAP, Unrolled
from waam_view import blueprint as bp
from waam_view.drawing import Drawing
from waam_view.mailbox import Mailbox
from waam_view.scene import MapData, Sample, Scene
from waam_view.viewer import ViewError, find_recording
from waam_view.web_viewer import binary


def chunks(file: Path) -> list[tuple[str, int]]:
    """Entity path and rows of every chunk of a recording, as the rerun tool reads them back."""
    out = subprocess.run(
        [str(binary()), 'rrd', 'print', str(file)], capture_output=True, text=True, timeout=60
    ).stdout
    lines = re.findall(r'^Chunk\(.*?\) with (\d+) rows .*? - (\S+)', out, re.MULTILINE)
    return [(entity.strip('/'), int(rows)) for rows, entity in lines]


def entities(file: Path) -> set[str]:
    return {entity for entity, _ in chunks(file)}


def sample(i: int) -> Sample:
    t = 1_800_000_000 * 10**9 + i * 10**8
    return Sample(
        t=t, position=(0.01 * i, 0.0, 0.0), speed=0.01, feed_commanded=0.08, feed=0.08, current=180.0 + i,
        voltage=22.0, state=1, arc=True,
    )  # fmt: skip


def test_mailbox_keeps_order_bounds_and_counts():
    box = Mailbox(limit=3)
    for i in range(5):
        box.put(i)
    for i in range(4):
        box.replace('map', f'map {i}')
    assert box.take(0) == ([2, 3, 4], ['map 3'])
    assert (box.dropped, box.replaced) == (2, 3)
    assert box.take(0) == ([], [])


@pytest.mark.parametrize(
    'window, whole', [(0.0, None), (60.0, None), (0.0, (10**18, 10**18 + 10**10))]
)
def test_blueprint_builds_and_is_stored(tmp_path, window, whole):
    recording = rr.RecordingStream('test', recording_id='x')
    recording.set_sinks(
        rr.FileSink(str(tmp_path / 'x.rrd')), default_blueprint=bp.blueprint(6e-4, window, whole)
    )
    bp.log_styles(recording)
    recording.flush()
    recording.disconnect()
    found = entities(tmp_path / 'x.rrd')
    assert {'viewport', 'time_panel'} <= found
    assert set(bp.SERIES) <= found


def test_drawings_return_at_once_while_the_viewer_stalls():
    drawing = Drawing(Scene(6e-4), 0, 0)
    drawing.put(lambda _: time.sleep(1.0))
    time.sleep(0.3)  # the thread is inside
    start = time.thread_time()  # of this thread: the machine may be busy with other things
    for i in range(20_000):
        drawing.telemetry(sample(i))
        drawing.newest('map', lambda _: None)
    assert time.thread_time() - start < 0.5
    assert drawing.mailbox.dropped > 0 and drawing.mailbox.replaced > 0
    drawing.close()


def test_a_drawing_that_fails_is_reported_and_the_next_one_is_drawn():
    done = []
    drawing = Drawing(Scene(6e-4), 0, 0)
    drawing.put(lambda _: 1 / 0)
    drawing.put(lambda _: done.append(1))
    drawing.close()
    assert done == [1] and 'ZeroDivisionError' in drawing.problem


def test_file_of_a_job_holds_curves_and_surface(tmp_path):
    scene = Scene(6e-4)
    scene.new_job()
    scene.record(tmp_path / 'job.rrd')
    scene.telemetry([sample(i) for i in range(50)])
    z = np.zeros((6, 8))
    z[2, 2] = np.nan
    scene.height_map(MapData(1_800_000_001 * 10**9, GridSpec(0, 0, 1e-3, 6, 8), z))
    scene.close()
    found = entities(tmp_path / 'job.rrd')
    assert {bp.CURRENT, bp.VOLTAGE, bp.FEED, bp.TRAVEL, bp.TORCH, bp.SURFACE, bp.MACHINE} <= found


def test_curves_go_to_a_file_in_large_parts_and_all_of_them(tmp_path):
    """For every part the library keeps a note in memory until the file is closed."""
    scene = Scene(6e-4)
    scene.record(tmp_path / 'job.rrd')
    for k in range(130):
        scene.telemetry([sample(10 * k + i) for i in range(10)])
    scene.close()
    rows = [n for entity, n in chunks(tmp_path / 'job.rrd') if entity == bp.CURRENT]
    assert sorted(rows) == [1, 100, 600, 600]  # the first is the style of the curve
    torch = [n for entity, n in chunks(tmp_path / 'job.rrd') if entity == bp.TORCH]
    assert sum(torch) == 130 and len(torch) < 30


def test_the_torch_over_a_shaft_stays_on_its_map(monkeypatch):
    """Its x runs on over the turns; a line from one end of the map to the other would be drawn at every seam."""
    scene = Scene(6e-4)
    scene.shaft = shaft = Unrolled(0.04)
    drawn = []
    monkeypatch.setattr(scene, 'log', lambda t, entity, what: drawn.append((entity, what)))
    end = OVERLAP + 2 * shaft.period
    steps = np.linspace(-0.03, 0.03, 31)
    scene.telemetry(
        [replace(sample(i), position=(end + s, 0.03, 0.01), arc=True) for i, s in enumerate(steps)]
    )
    strips = [what.strips.as_arrow_array()[0].as_py() for e, what in drawn if e.startswith(bp.PATH)]
    (torch,) = [what.positions.as_arrow_array()[0].as_py() for e, what in drawn if e == bp.TORCH]
    assert torch[0] == pytest.approx(OVERLAP + 0.03)
    assert len(strips) == 2
    for strip in strips:
        x = np.array(strip)[:, 0]
        assert np.ptp(x) < 0.035 and x.min() > OVERLAP - 1e-6 and x.max() < OVERLAP + shaft.period


def test_existing_recording_is_not_overwritten(tmp_path):
    (tmp_path / 'job.rrd').write_bytes(b'old')
    drawing = Drawing(Scene(6e-4), 0, 0)
    drawing.start_job(tmp_path)
    drawing.close()
    assert (tmp_path / 'job.rrd').read_bytes() == b'old'
    assert (tmp_path / 'job_2.rrd').is_file()


def test_port_in_use_is_said_and_nothing_breaks():
    import socket

    with socket.socket() as s:
        s.bind(('127.0.0.1', 0))
        s.listen()
        drawing = Drawing(Scene(6e-4), s.getsockname()[1], 0)
        drawing.close()
    assert 'in use' in drawing.problem


def test_find_recording(tmp_path):
    with pytest.raises(ViewError, match='does not exist'):
        find_recording(tmp_path / 'none')
    with pytest.raises(ViewError, match='no job.rrd'):
        find_recording(tmp_path)
    (tmp_path / 'record').mkdir()
    (tmp_path / 'record/record_0.mcap').touch()
    assert find_recording(tmp_path).name == 'record_0.mcap'
    (tmp_path / 'job.rrd').touch()
    assert find_recording(tmp_path).name == 'job.rrd'
    (tmp_path / 'x.txt').touch()
    with pytest.raises(ViewError, match='neither'):
        find_recording(tmp_path / 'x.txt')


def test_yaml_lists_every_parameter():
    from waam_node.params import markdown
    from waam_view.dashboard_node import DashboardParams

    file = Path(__file__).parents[1] / 'config/dashboard.yaml'
    listed = yaml.safe_load(file.read_text())['/**/dashboard']['ros__parameters']
    assert markdown(DashboardParams) in file.parents[1].joinpath('README.md').read_text()
    defaults = {f.name: f.default for f in dataclasses.fields(DashboardParams)}
    assert listed == {k: list(v) if isinstance(v, tuple) else v for k, v in defaults.items()}


def test_a_recording_that_has_ended_leaves_no_threads(tmp_path):
    """A dashboard draws hundreds of jobs in its life: rerun kept six threads of each."""
    scene, threads = Scene(1e-3), []
    for job in range(5):
        (tmp_path / str(job)).mkdir()
        scene.new_job()
        scene.record(tmp_path / str(job) / 'job.rrd')
        scene.status(job + 1, 'running')
        scene.remove('file')
        end = time.monotonic() + 10.0
        while threads and tasks() > threads[0] and time.monotonic() < end:
            time.sleep(0.02)  # they end by themselves
        threads.append(tasks())
        assert (tmp_path / str(job) / 'job.rrd').stat().st_size > 1000
    assert max(threads) == threads[0]


def tasks() -> int:
    return len(os.listdir('/proc/self/task'))
