"""From what was found to the result that is kept. Pure."""

from __future__ import annotations

import numpy as np

from waam_robot.frames import wpr

from . import results
from .lead import MAX_LEAD, Lead
from .resonance import Resonance
from .results import LARGEST_TOOL, LARGEST_TURN, Result
from .robot_fit import HandEye, Tool
from .shapers import SMOOTHING
from .sweep import Sweep
from .wire import WireWheel


def of_resonance(found: Resonance, sweep: Sweep) -> Result:
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
    return Result('resonance', found.axis, text, values, evidence, told + found.settings())


def _acceleration(axis: str, proposed: float, limit: float) -> tuple[list[tuple[str, float]], str]:
    """The setting and the words for it; mm/s^2. No setting where the corner alone is smoothed too much."""
    if proposed < results.MIN_ACCEL:
        return [], f'acceleration left as it is (none keeps the smoothing below {SMOOTHING:g} mm)'
    told = round(min(proposed, limit), 3)
    words = (
        f'acceleration {told:g} mm/s^2 ({proposed:g} proposed, the machine has at most {limit:g})'
    )
    return [(results.ACCEL + axis, told)], words


def of_wire(found: WireWheel, known: float, setting: str) -> Result:
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
    return Result('wire', '', text, values, evidence, told, refuses)


def of_lead(found: Lead) -> Result:
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
    if found.delay > MAX_LEAD[0] or found.lag > MAX_LEAD[1]:
        most = f'{1e3 * MAX_LEAD[0]:.0f} and {1e3 * MAX_LEAD[1]:.0f} ms'
        own = f'{1e3 * found.delay:.0f} and {1e3 * found.lag:.0f} ms'
        refuses = f'delay and lag of the wire are {own}, the controller leads at most {most}'
    text = (
        f'wire delay {1e3 * found.delay:.1f} +- {1e3 * found.delay_sigma:.1f} ms, '
        f'lag {1e3 * found.lag:.1f} +- {1e3 * found.lag_sigma:.1f} ms'
    )
    return Result('lead', '', text, values, evidence, found.settings(), refuses)


def of_tool(found: Tool, told: np.ndarray) -> Result:
    """told: (3,) m, the tool that the controller has."""
    tip, half = found.tip * 1e3, found.interval * 1e3
    off = float(np.linalg.norm(found.tip - told)) * 1e3
    values = {f'{axis}_mm': float(v) for axis, v in zip('xyz', tip, strict=True)}
    values['off_mm'] = off
    evidence = {f'interval_{axis}_mm': float(v) for axis, v in zip('xyz', half, strict=True)}
    evidence |= {
        'touches': float(len(found.misses)),
        'largest_miss_mm': 1e3 * float(found.misses.max()),
        'misfit': found.misfit,
    }
    refuses = ''
    if off > 1e3 * LARGEST_TOOL:
        refuses = (
            f'the tool of the robot is {off:.2f} mm off, at most {1e3 * LARGEST_TOOL:g}: enter the one that was found '
            'and calibrate again with --told'
        )
    said = ', '.join(f'{v:.2f} +- {h:.2f}' for v, h in zip(tip, half, strict=True))
    text = f'tip at {said} mm of the flange (95 %), {off:.2f} mm from that of the controller'
    return Result('robot-tcp', '', text, values, evidence, [], refuses)


def of_hand_eye(found: HandEye, on_torch: np.ndarray, mounted: np.ndarray) -> Result:
    """on_torch, mounted: (4, 4), the scanner on the torch as found and as the programs have it."""
    half = found.interval
    angles = np.degrees(wpr(on_torch))
    off = float(np.linalg.norm(on_torch[:3, 3] - mounted[:3, 3]))
    turn = on_torch[:3, :3] @ mounted[:3, :3].T
    turned = float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    values = {f'{axis}_mm': 1e3 * float(v) for axis, v in zip('xyz', on_torch[:3, 3], strict=True)}
    values |= dict(zip(('roll_deg', 'pitch_deg', 'yaw_deg'), map(float, angles), strict=True))
    values |= {'off_mm': 1e3 * off, 'turned_deg': float(np.degrees(turned))}
    evidence = {
        'interval_mm': 1e3 * float(half[:3].max()),
        'interval_deg': float(np.degrees(half[3:].max())),
        'poses': float(len(np.unique(found.of))),
        'points': float(len(found.of)),
        'left_out': found.left_out,
        'rms_mm': 1e3 * float(np.sqrt(np.mean(found.misses**2))),
        'misfit': found.misfit,
    }
    refuses = ''
    if off > LARGEST_TOOL or turned > LARGEST_TURN:
        refuses = (
            f'the scanner is {1e3 * off:.2f} mm and {np.degrees(turned):.2f} deg from where scan_fusion has it, at '
            f'most {1e3 * LARGEST_TOOL:g} mm and {np.degrees(LARGEST_TURN):.1f} deg: set mount_xyz and mount_rpy, and '
            'calibrate again with --mounted'
        )
    said = ', '.join(f'{1e3 * v:.2f}' for v in on_torch[:3, 3])
    text = (
        f'scanner at {said} mm +- {evidence["interval_mm"]:.2f} mm, +- {evidence["interval_deg"]:.2f} deg (95 %), '
        f'{1e3 * off:.2f} mm and {np.degrees(turned):.2f} deg from its nominal mounting'
    )
    return Result('hand-eye', '', text, values, evidence, [], refuses)
