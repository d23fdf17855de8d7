"""What `waam scan calibrate` does: files in, calibration file, picture and words out."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..calibration.artefact import Artefact
from ..calibration.artefact_file import load_artefact
from ..calibration.file import rpy_of, save_calibration
from ..calibration.pass_file import load_pass
from ..calibration.scan_pass import Pass
from ..calibration.solve import PARAMETERS, Calibration, CalibrationError, calibrate
from ..left_out import LeftOut, tell
from ..scan_records import passes as recorded
from ..scan_records import record_files
from ..transform import Mounting

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = {'x': ('mm', 1e3), 'y': ('mm', 1e3), 'z': ('mm', 1e3), 'delay': ('ms', 1e3)}
# mean residuals of a surface or pass beyond this many standard errors and 5 um are named
SUSPECT = 3.0
SHARED = 5e-6  # m


def read_passes(paths: list[Path]) -> list[Pass]:
    """The pass of a file, or all scans of a recording. A pass that is bad is left out by name, on stderr; an error when
    none is left."""
    left_out, found = LeftOut(), []
    for path in paths:
        try:
            if record_files(path):
                found += list(recorded(path, left_out=left_out))
            else:
                found.append(load_pass(path))
        except ValueError as e:
            left_out.add('scan', path, '', e)
    if not found and left_out:
        raise left_out.nothing_left(', '.join(map(str, paths)))
    tell(left_out)
    return found


def calibrate_files(args: argparse.Namespace) -> None:
    """Reads artefact and passes, writes calibration and picture. CalibrationError when the pose is not observed."""
    artefact = load_artefact(args.artefact)
    passes = read_passes(args.scans)
    start = Mounting.from_rpy(
        tuple(v * 1e-3 for v in args.start_xyz),
        tuple(np.radians(args.start_rpy)),
        args.start_delay * 1e-3,
    )
    result = calibrate(passes, artefact, start)
    print('\n'.join(table(result)))
    for line in remarks(result):
        print(f'note: {line}')
    picture = Path(args.out).with_suffix('.png')
    picture.parent.mkdir(parents=True, exist_ok=True)
    draw(picture, result, artefact)
    if not result.observed and not args.accept_unobserved:
        raise CalibrationError(
            'the scans do not observe: '
            + '; '.join(result.unobserved)
            + f'. Nothing was saved but {picture}'
        )
    data = save_calibration(args.out, result, artefact.name, [p.name for p in passes])
    print(f'written: {args.out} (sha256 {data["sha256"][:12]}), {picture}')


def table(result: Calibration) -> list[str]:
    """Values with standard uncertainty, one per line."""
    m = result.mounting
    values = [*m.offset, *rpy_of(m.rotation), m.delay]
    lines = [
        f'{result.used} points on {len(result.faces)} surfaces, noise {result.noise * 1e3:.4f} mm'
    ]
    names = ('x', 'y', 'z', 'roll', 'pitch', 'yaw', 'delay')
    for name, key, value, sigma in zip(names, PARAMETERS, values, result.sigma, strict=True):
        unit, factor = SHOWN.get(key, ('deg', 180 / np.pi))
        about = f' (rotation about work {key[1]})' if key.startswith('r') else ''
        lines.append(
            f'{name:6s} {value * factor:10.4f} {unit:3s} standard uncertainty {sigma * factor:.4f}{about}'
        )
    return lines + [f'unobserved: {text}' for text in result.unobserved]


def remarks(result: Calibration) -> list[str]:
    """Surfaces and passes that disagree with the rest by more than chance, and profiles that had no pose."""
    found = []
    for name, (mean, count) in result.faces.items():
        if abs(mean) > max(SUSPECT * result.noise / np.sqrt(count), SHARED):
            found.append(
                f'{name} lies {mean * 1e3:+.3f} mm off: is the artefact made to size, and clean?'
            )
    for name, mean in result.passes.items():
        if abs(mean) > SHARED:
            found.append(f'{name} lies {mean * 1e3:+.3f} mm off: backlash, or a pose that lags?')
    if result.rejected_profiles:
        found.append(
            f'{result.rejected_profiles} profiles without a pose on both sides were left out'
        )
    return found


def draw(path: Path, result: Calibration, artefact: Artefact) -> None:
    """Residuals over the artefact, their distribution, and the correlation of the parameters."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 4.4), layout='constrained')
    axes = figure.subplots(1, 3, width_ratios=[1.5, 1.1, 1.2])
    _residual_map(figure, axes[0], result, artefact)
    um = result.residuals * 1e6
    width = 5 * max(result.noise * 1e6, 1.0)
    axes[1].hist(um, bins=80, range=(-width, width), color='0.5')
    axes[1].set(
        xlabel='residual in µm', ylabel='points', yticks=[],
        title=f'{result.used} points, noise {result.noise * 1e6:.1f} µm',
    )  # fmt: skip
    _correlation(figure, axes[2], result)
    figure.savefig(path, dpi=110, bbox_inches='tight')


def _residual_map(figure: Figure, axis: Axes, result: Calibration, artefact: Artefact) -> None:
    local = (result.points - artefact.position) @ artefact.rotation * 1e3
    limit = 3 * result.noise * 1e6
    step = max(1, len(local) // 20_000)
    dots = axis.scatter(
        local[::step, 0], local[::step, 1], c=result.residuals[::step] * 1e6, s=2, cmap='coolwarm',
        vmin=-limit, vmax=limit, linewidths=0,
    )  # fmt: skip
    figure.colorbar(dots, ax=axis, label='residual in µm')
    axis.set(
        aspect='equal',
        xlabel='x in mm (artefact)',
        ylabel='y in mm',
        title='distance to the surface',
    )


def _correlation(figure: Figure, axis: Axes, result: Calibration) -> None:
    sigma = np.maximum(result.sigma, 1e-30)
    shown = axis.imshow(
        result.covariance / np.outer(sigma, sigma), vmin=-1, vmax=1, cmap='coolwarm'
    )
    ticks = range(len(PARAMETERS))
    axis.set(xticks=ticks, yticks=ticks, xticklabels=PARAMETERS, yticklabels=PARAMETERS)
    state = 'everything observed' if result.observed else f'{len(result.unobserved)} unobserved'
    axis.set_title(f'correlation; {state}')
    figure.colorbar(shown, ax=axis)
