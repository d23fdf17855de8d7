"""The error of a scan is that against the target of its own layer, also after a rescan and after a resume."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from waam_node import job_folder
from waam_process.grid import GridSpec
from waam_view.conversions import map_data
from waam_view.drawing import Drawing
from waam_view.job_data import load_scan
from waam_view.ros_playback import Playback
from waam_view.scene import MapData, Scene
from waam_view.worst_places import LayerError, error_after

sys.path.insert(0, str(Path(__file__).parent))
from synthetic_cell import Cell  # noqa: E402
from synthetic_job import LAYER, write_job  # noqa: E402

# layers before each scan: 1 is scanned again, 2 after a resume
FIRST_RUN, SECOND_RUN = ((0, 1, 1, 2), (1, 2, 3))


@dataclass
class Drawn(Scene):
    """Keeps the errors instead of drawing them."""

    errors: list[tuple[MapData, np.ndarray]] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(6e-4)

    def record(self, file: Path) -> None:
        pass

    def height_map(self, data: MapData) -> None:
        pass

    def error_map(self, data: MapData, after: LayerError) -> None:
        self.errors.append((data, after.error))


class Tape:
    """Takes what the synthetic cell publishes."""

    def __init__(self) -> None:
        self.messages: list = []

    def create_publisher(self, _kind: type, _topic: str, _qos):
        tape = self

        class Publisher:
            def publish(self, message) -> None:
                tape.messages.append(message)

        return Publisher()


@pytest.fixture(scope='module')
def scans() -> list:
    """Height maps of a job with a rescan and a resume."""
    tape = Tape()
    cell = Cell(tape)
    for t, layer in enumerate(FIRST_RUN):
        cell.height_map(float(t), layer)
    cell.resume(2)
    for t, layer in enumerate(SECOND_RUN):
        cell.height_map(100.0 + t, layer)
    return tape.messages


@pytest.fixture(scope='module')
def job(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('job')
    write_job(folder / 'it', layers=3)
    return folder / 'it'


def assert_errors_are_of_their_own_layer(drawn: Drawn) -> None:
    layers = [*FIRST_RUN, *SECOND_RUN]
    assert len(drawn.errors) == len(layers)
    for layer, (measured, error) in zip(layers, drawn.errors, strict=True):
        judged = np.isfinite(error)
        assert judged.sum() > 1000
        assert np.allclose(error[judged], measured.z[judged] - layer * LAYER, atol=1e-6)


def test_playback_judges_every_scan_by_its_own_layer(scans, job):
    drawn = Drawn()
    playback = Playback(drawn, job)
    for message in scans:
        playback.message('height_map', serialize_message(message))
    assert_errors_are_of_their_own_layer(drawn)


def test_the_live_view_judges_every_scan_by_its_own_layer(scans, job):
    drawn = Drawn()
    drawing = Drawing(drawn, 0, 0)
    drawing.start_job(job)
    for n, message in enumerate(scans, 1):
        drawing.expect_error(message.layer, lambda m=message: map_data(m))
        drawing._turn()
        assert len(drawn.errors) <= n
    drawing.close()
    assert_errors_are_of_their_own_layer(drawn)


def test_a_scan_waits_until_the_job_has_written_its_target(scans, job, tmp_path):
    (tmp_path / job_folder.MAPS).mkdir()
    drawn = Drawn()
    drawing = Drawing(drawn, 0, 0)
    drawing.start_job(tmp_path)
    drawing.expect_error(1, lambda: map_data(scans[1]))
    drawing.expect_error(1, lambda: map_data(scans[2]))
    drawing._turn()
    assert not drawn.errors
    (tmp_path / job_folder.map_after(1)).write_bytes((job / job_folder.map_after(1)).read_bytes())
    drawing.close()
    assert [m.t for m, _ in drawn.errors] == [map_data(s).t for s in scans[1:3]]


def test_a_scan_on_another_grid_is_not_judged(job):
    spec = GridSpec(0.0, 0.0, 1e-3, 5, 6)
    assert error_after(job, 1, spec, np.zeros(spec.shape)) is None
    assert error_after(job, 9, spec, np.zeros(spec.shape)) is None


def test_after_a_layer_the_worst_places_are_named_with_what_led_there(job):
    stored = [load_scan(job / job_folder.map_after(n), []) for n in (1, 2)]
    last = stored[-1]
    spec = GridSpec(*last.origin, last.resolution, *last.z.shape)
    row, col = (int(i[len(i) // 2]) for i in np.nonzero(last.interior))
    z = last.maps['target'].copy()
    z[row, col] += 0.9e-3
    after = error_after(job, 2, spec, z)
    worst = after.places[0]
    at = (
        spec.origin_x + (col + 0.5) * spec.resolution,
        spec.origin_y + (row + 0.5) * spec.resolution,
    )
    assert (worst.x_mm, worst.y_mm) == pytest.approx([v * 1e3 for v in at])
    assert worst.value_mm == pytest.approx(0.9) and len(worst.errors_mm) == 3
    assert f'+0.90 mm at x {worst.x_mm:.1f}' in worst.words() and 'scans before' in worst.words()
    assert after.share_beyond(0.6e-3) == pytest.approx(1 / last.interior.sum())
    assert after.share_beyond(1e-3) == 0.0
    z[:] = np.nan
    blind = error_after(job, 2, spec, z)
    assert blind.places == [] and blind.share_beyond(0.6e-3) == 0.0
