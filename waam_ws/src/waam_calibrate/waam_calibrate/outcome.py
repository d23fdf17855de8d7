"""From what was found to the result that is kept. Pure: the date is an argument."""

from __future__ import annotations

from datetime import UTC, datetime

from . import measures, results
from .lead import LONGEST, Lead
from .resonance import Resonance
from .results import Result
from .shapers import SMOOTHING
from .sweep import Sweep
from .wire import WireWheel


def stamp(now: datetime) -> str:
    """UTC, to the second."""
    return now.astimezone(UTC).isoformat(timespec='seconds')


def of_resonance(found: Resonance, sweep: Sweep, now: datetime) -> Result:
    """The mode, the shaper that is taken, its acceleration, and every candidate. The sweep has the acceleration of the
    machine, and the controller is told no more."""
    c, mode = found.chosen, found.mode
    limit = 1e3 * sweep.acceleration
    values = {
        'mode_hz': mode.hz,
        'mode_damping': mode.damping,
        'shaper_hz': c.hz,
        'shaper_damping': c.damping,
        'vibration_pct': 100 * c.vibration,
        'smoothing_mm': c.smoothing,
        'acceleration_mm_s2': c.acceleration,
        'acceleration_limit_mm_s2': limit,
    }
    for other in found.candidates:
        values[f'{other.type}_hz'] = other.hz
        values[f'{other.type}_vibration_pct'] = 100 * other.vibration
        if other.vibration_off is not None:
            values[f'{other.type}_vibration_off_pct'] = 100 * other.vibration_off
    evidence = {'peak_gain': float(found.gain.max()) ** 0.5, 'sweep_s': sweep.duration}
    shaper = f'{c.type} at {c.hz:.1f} Hz leaves {100 * c.vibration:.1f} %'
    told, words = _acceleration(found.axis, c.acceleration, limit)
    text = f'mode {mode.hz:.2f} Hz, damping {mode.damping:.3f}; {shaper}; {words}'
    return Result(
        'resonance', found.axis, stamp(now), text, values, evidence, told + found.settings()
    )


def _acceleration(axis: str, proposed: float, limit: float) -> tuple[list[tuple[str, float]], str]:
    """The setting and the words for it; mm/s^2. No setting where the corner alone is smoothed too much."""
    if proposed < results.LEAST_ACCEL:
        return [], f'acceleration left as it is (none keeps the smoothing below {SMOOTHING:g} mm)'
    told = round(min(proposed, limit), 3)
    words = (
        f'acceleration {told:g} mm/s^2 ({proposed:g} proposed, the machine has at most {limit:g})'
    )
    return [(results.ACCEL + axis, told)], words


def of_steps(found: measures.Steps, axis: str, lengths: int, now: datetime) -> Result:
    """The scale, and the steps per mm for the controller."""
    off = found.scale - 1
    values = {
        'scale': found.scale,
        'steps_per_mm': found.steps_per_mm,
        'offset_mm': found.offset,
    }
    evidence = {'standard_uncertainty': found.sigma, 'lengths': float(lengths)}
    text = f'{found.steps_per_mm:.3f} steps/mm ({100 * off:+.3f} % +- {100 * found.sigma:.3f} %)'
    told = [(results.STEPS + axis, round(found.steps_per_mm, 3))]
    return Result('steps', axis, stamp(now), text, values, evidence, told)


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


def of_wire(found: WireWheel, known: float, setting: str, now: datetime) -> Result:
    """known: counts per mm that the controller has; setting: its name of the threshold."""
    off = found.per_mm / known - 1
    values = {
        'counts_per_mm': found.per_mm,
        'mm_per_count': 1 / found.per_mm,
        'counts_per_mm_by_wheel': found.by_wheel,
        'threshold': found.threshold,
    }
    evidence = {
        'standard_uncertainty': found.sigma,
        'lengths': float(len(found.lengths)),
        'resolution_at_slowest_feed': found.resolution,
    }
    if found.feed is not None:
        values |= {'normal_feed': found.feed.mean, 'normal_feed_sigma': found.feed.sigma}
        evidence['windows_of_normal_feed'] = float(len(found.feed.ratios))
    refuses = ''
    if abs(off) > results.LARGEST_WIRE:
        most = 100 * results.LARGEST_WIRE
        refuses = f'the wire feed reads {100 * off:+.1f} % wrong, at most {most:g} %'
    text = (
        f'{found.per_mm:.4f} counts/mm ({100 * off:+.2f} % +- {100 * found.sigma:.2f} % against the controller), '
        f'underfeed below {found.threshold:g}'
    )
    told = [(setting, found.threshold)] if setting else []
    return Result('wire', '', stamp(now), text, values, evidence, told, refuses)


def of_lead(found: Lead, now: datetime) -> Result:
    """Delay and lag, for the controller."""
    values = {
        'delay_s': found.delay,
        'lag_s': found.lag,
        'response_s': found.response,
        'encoder_ratio': found.ratio,
    }
    evidence = {
        'delay_uncertainty_s': found.delay_sigma,
        'lag_uncertainty_s': found.lag_sigma,
        'steps': float(found.steps),
        'misfit': found.misfit,
    }
    refuses = ''
    if found.delay > LONGEST[0] or found.lag > LONGEST[1]:
        most = f'{1e3 * LONGEST[0]:.0f} and {1e3 * LONGEST[1]:.0f} ms'
        own = f'{1e3 * found.delay:.0f} and {1e3 * found.lag:.0f} ms'
        refuses = f'delay and lag of the wire are {own}, the controller leads at most {most}'
    text = (
        f'wire delay {1e3 * found.delay:.1f} +- {1e3 * found.delay_sigma:.1f} ms, '
        f'lag {1e3 * found.lag:.1f} +- {1e3 * found.lag_sigma:.1f} ms'
    )
    return Result('lead', '', stamp(now), text, values, evidence, found.settings(), refuses)
