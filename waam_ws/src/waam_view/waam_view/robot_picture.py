"""The robot cell as a picture for the report: arm, positioner and the part as it grew, from the side."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from waam_robot.arm import AXES, link_frames
from waam_robot.station import Station

from .canvas import BLUE, GREY, INK, RED, new_figure, png, style
from .job_data import Scan

DISC = 0.3  # m, half the width of the faceplate as drawn
COLUMN = 0.06  # m, half the width of the positioner's column as drawn


def robot_picture(scans: list[Scan], work_zero: np.ndarray) -> bytes:
    """PNG: the cell of `waam up --machine robot` with the torch over the part, and the part's middle after every layer.

    work_zero: (3,) m, zero of the scans in machine coordinates. StationError where the torch would be out of reach.
    """
    station = Station()
    lines = [(s.layer, _section(s, work_zero)) for s in scans]
    figure = new_figure(9.4, 4.2)
    cell, part = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    _draw_cell(cell, station, lines[-1][1])
    _draw_part(part, lines)
    return png(figure)


def _section(scan: Scan, work_zero: np.ndarray) -> np.ndarray:
    """(n, 3) m, machine coordinates: the surface along x where the region is longest; unknown cells left out."""
    row = int(np.argmax((scan.region & np.isfinite(scan.z)).sum(axis=1)))
    columns = np.flatnonzero(scan.region[row] & np.isfinite(scan.z[row]))
    x, y = scan.origin
    d = scan.resolution
    flat = [x + (columns + 0.5) * d, np.full(len(columns), y + (row + 0.5) * d)]
    return np.column_stack([*flat, scan.z[row, columns]]) + work_zero


def joints_over(station: Station, surface: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """((8,) rad, (8, 3) m in the robot's base): the arm with the torch on the middle of a surface (n, 3), machine
    coordinates: base, ends of the six links, tip of the wire."""
    tip = surface[len(surface) // 2] if len(surface) else np.array(station.place.low)
    joints = station.joints(tip[None])[0]
    links = link_frames(station.place.arm, joints[:AXES])[:, :3, 3]
    return joints, np.vstack([links, station.poses(tip[None])[0, :3, 3]])


def _draw_cell(axes: Axes, station: Station, surface: np.ndarray) -> None:
    joints, arm = joints_over(station, surface)
    axes.plot(arm[:, 0], arm[:, 2], '-o', color=BLUE, linewidth=4, markersize=5, label='arm')
    axes.plot(*arm[-2:, [0, 2]].T, color=RED, linewidth=2, label='torch')
    plate = station.place.positioner.faceplate(float(joints[AXES]))[:3, 3]
    disc = Rectangle((plate[0] - DISC, plate[2] - 0.02), 2 * DISC, 0.02, color=GREY)
    disc.set_label('positioner')
    axes.add_patch(disc)
    floor = min(arm[0, 2], plate[2] - 0.5)
    axes.add_patch(
        Rectangle((plate[0] - COLUMN, floor), 2 * COLUMN, plate[2] - 0.02 - floor, color=GREY, alpha=0.6)
    )  # fmt: skip
    if len(surface):
        on = station.poses(surface)[:, :3, 3]
        axes.fill_between(on[:, 0], plate[2], on[:, 2], color=INK, label='part')
    axes.set_aspect('equal')
    style(axes, 'x from the base of the robot, m', 'z, m')
    axes.legend(fontsize=8)


def _draw_part(axes: Axes, lines: list[tuple[int, np.ndarray]]) -> None:
    for n, (layer, line) in enumerate(lines):
        share = (n + 1) / len(lines)
        label = 'as found' if layer == 0 else f'layer {layer}'
        axes.plot(
            line[:, 0] * 1e3, line[:, 2] * 1e3, color=INK, alpha=0.25 + 0.75 * share, label=label
        )
    axes.margins(y=0.1)
    style(axes, 'x of the machine, mm', 'height of the machine, mm')
    axes.legend(fontsize=7, ncols=4, loc='lower center', bbox_to_anchor=(0.5, 1.0))
