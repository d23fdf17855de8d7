"""From what was found to the result that is kept. Pure: the date is an argument."""

from __future__ import annotations

from datetime import UTC, datetime

from . import measures, results
from .resonance import Resonance
from .results import Result
from .sweep import Sweep


def stamp(now: datetime) -> str:
    """UTC, to the second."""
    return now.astimezone(UTC).isoformat(timespec='seconds')


def of_resonance(found: Resonance, sweep: Sweep, now: datetime) -> Result:
    """The mode, the shaper that is taken, and every candidate."""
    c, mode = found.chosen, found.mode
    values = {
        'mode_hz': mode.hz,
        'mode_damping': mode.damping,
        'shaper_hz': c.hz,
        'shaper_damping': c.damping,
        'vibration_pct': 100 * c.vibration,
        'smoothing_mm': c.smoothing,
        'acceleration_mm_s2': c.acceleration,
    }
    for other in found.candidates:
        values[f'{other.type}_hz'] = other.hz
        values[f'{other.type}_vibration_pct'] = 100 * other.vibration
    evidence = {'peak_gain': float(found.gain.max()) ** 0.5, 'sweep_s': sweep.duration}
    shaper = f'{c.type} at {c.hz:.1f} Hz leaves {100 * c.vibration:.1f} %'
    text = f'mode {mode.hz:.2f} Hz, damping {mode.damping:.3f}; {shaper}'
    settings = found.settings()
    return Result('resonance', found.axis, stamp(now), text, values, evidence, settings)


def of_steps(found: measures.Steps, axis: str, lengths: int, now: datetime) -> Result:
    """The scale, and the steps per mm that the controller should have."""
    off = found.scale - 1
    values = {
        'scale': found.scale,
        'steps_per_mm': found.steps_per_mm,
        'offset_mm': found.offset,
    }
    evidence = {'standard_uncertainty': found.sigma, 'lengths': float(lengths)}
    refuses = ''
    if abs(off) > results.LARGEST_SCALE:
        refuses = f'{100 * off:+.2f} % off in length, at most {100 * results.LARGEST_SCALE:g} %'
    text = f'{found.steps_per_mm:.3f} steps/mm ({100 * off:+.3f} % +- {100 * found.sigma:.3f} %)'
    return Result('steps', axis, stamp(now), text, values, evidence, [], refuses)


def of_skew(found: measures.Skew, now: datetime) -> Result:
    """The angle that `waam correct --y-to-x` wants."""
    values = {'y_to_x_deg': found.y_to_x, 'side_y_mm': found.side_y}
    refuses = ''
    if abs(found.y_to_x) > results.LARGEST_SKEW:
        refuses = f'y leans {found.y_to_x:+.3f} deg to x, at most {results.LARGEST_SKEW:g} deg'
    text = f'y leans {found.y_to_x:+.4f} +- {found.sigma:.4f} deg to x'
    evidence = {'standard_uncertainty_deg': found.sigma}
    return Result('skew', '', stamp(now), text, values, evidence, [], refuses)


def of_tool_point(found: measures.ToolPoint, widths: int, now: datetime) -> Result:
    """How far the wire tip is from the tool centre point, and how far it may be."""
    values = {'offset_mm': found.offset, 'limit_mm': found.limit}
    refuses = (
        ''
        if found.within
        else f'the wire tip is {found.offset:.3f} mm off, limit {found.limit:.3f} mm'
    )
    text = f'wire tip {found.offset:.3f} +- {found.sigma:.3f} mm off, limit {found.limit:.3f} mm'
    evidence = {'standard_uncertainty_mm': found.sigma, 'widths': float(widths)}
    return Result('tcp', '', stamp(now), text, values, evidence, [], refuses)
