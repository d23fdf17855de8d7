"""A shaft that turned in a chuck, in the report: its figures, and it as it is round beside the unrolled map."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps

from waam_process.grid import GridSpec
from waam_process.unrolled import UNROLLED, Unrolled

from .canvas import BLUE, GREEN, INK, new_figure, png
from .figures import nice_range
from .html import cards, fmt, picture
from .job_data import Job, mapping

MAGNIFIED = 10.0  # errors in the pictures


def shaft_section(job: Job) -> str:
    """HTML; '' for a part that lies still."""
    if job.shaft is None:
        return ''
    found = mapping(job.run.get('shaft'))
    shown = [
        (
            fmt(found.get('clean_diameter_mm'), 2, 'mm'),
            'largest diameter that the lathe reaches all over',
        ),
        (fmt(found.get('roundness_mm'), 2, 'mm'), 'roundness of the new surface, mean'),
        (
            fmt(found.get('new_run_out_mm'), 2, 'mm'),
            'run-out of the new surface about the unworn ends',
        ),
        (fmt(found.get('seam_step_mm'), 2, 'mm'), 'step of the new surface at the seam of the map'),
    ]
    out = ['<h2>The shaft</h2>', cards(shown)]
    if len(job.scans) > 1 and not job.scans[0].layer:
        first, last = job.scans[0], job.scans[-1]
        nominal = last.maps.get('nominal', np.full(last.z.shape, np.nan))
        spec = GridSpec(*last.origin, last.resolution, *last.z.shape)
        if first.z.shape == last.z.shape and np.isfinite(last.z - nominal).any():
            told = (
                f'Nominal diameter {job.shaft.diameter * 1e3:g} mm. Angle 0 is up. All maps of this page show the '
                f'shaft {UNROLLED}, z is the radius.'
            )
            png = round_picture(spec, last.z - nominal, first.z - nominal, job.shaft)
            out.append(picture(png, told))
    return '\n'.join(out)


def round_picture(
    spec: GridSpec,
    error: np.ndarray,
    found: np.ndarray,
    shaft: Unrolled,
    magnified: float = MAGNIFIED,
) -> bytes:
    """PNG: a shaft as found and as restored: its middle profile around the nominal circle, and its surface in space,
    both with errors `magnified`, and the unrolled map of the error. error, found: (rows, cols) m from nominal, after
    and before, on `spec`."""
    on = shaft.first_turn(spec)
    angle, y = shaft.angle(spec.x[on]), spec.y
    rows = np.isfinite(error[:, on]).any(axis=1)
    error, found = error[rows][:, on], found[rows][:, on]
    y, radius = y[rows], shaft.radius * 1e3
    figure = new_figure(9.4, 7.6)
    places = figure.add_gridspec(2, 2, height_ratios=[3, 2])
    axes: Any = figure.add_subplot(places[0, 0], projection='polar')
    middle = len(y) // 2
    axes.set_theta_zero_location('N')
    axes.set_theta_direction(-1)
    for z, colour, label in ((found, INK, 'as found'), (error, BLUE, 'restored')):
        axes.plot(
            angle, radius + magnified * z[middle] * 1e3, color=colour, linewidth=1.0, label=label
        )
    axes.plot(angle, np.full_like(angle, radius), color=GREEN, linewidth=0.8, label='wanted')
    axes.set_yticklabels([])
    axes.set_title(f'profile at y = {y[middle] * 1e3:.0f} mm, errors x {magnified:g}', fontsize=9)
    axes.legend(fontsize=7, loc='lower left', bbox_to_anchor=(-0.25, -0.1))
    axes.tick_params(labelsize=7)
    space = figure.add_subplot(places[0, 1], projection='3d')
    step_y, step_t = max(1, len(y) // 60), max(1, len(angle) // 120)
    z = np.nan_to_num(error[::step_y, ::step_t]) * 1e3
    t, along = np.meshgrid(angle[::step_t], y[::step_y] * 1e3)
    t, along, z = (
        np.column_stack([a, b]) for a, b in ((t, t[:, :1]), (along, along[:, :1]), (z, z[:, :1]))
    )
    limit = nice_range([error * 1e3], 0.2)
    r = radius + magnified * z
    colours = colormaps['RdBu_r'](0.5 + 0.5 * z / limit)
    space.plot_surface(
        along, r * np.sin(t), r * np.cos(t), facecolors=colours, rstride=1, cstride=1, shade=True
    )
    space.set_box_aspect((float(np.ptp(along)), 2 * radius, 2 * radius))
    space.set_title(f'restored, errors x {magnified:g}', fontsize=9)
    space.tick_params(labelsize=6)
    flat = figure.add_subplot(places[1, :])
    image = flat.imshow(
        error.T * 1e3, origin='lower', extent=(y[0] * 1e3, y[-1] * 1e3, 0.0, 360.0), aspect='auto', cmap='RdBu_r',
        vmin=-limit, vmax=limit, interpolation='nearest',
    )  # fmt: skip
    flat.set_xlabel('along the axis, mm', fontsize=8)
    flat.set_ylabel('angle, deg', fontsize=8)
    flat.set_title('radial error, unrolled', fontsize=9)
    flat.tick_params(labelsize=7)
    figure.colorbar(image, ax=flat, fraction=0.05, pad=0.02, extend='both').set_label(
        'mm', fontsize=8
    )
    return png(figure)
