"""From the fits of a robot to the results that are kept. Pure: the date is an argument."""

from __future__ import annotations

from datetime import datetime

import numpy as np

from waam_robot.frames import wpr

from .outcome import stamp
from .results import LARGEST_TOOL, LARGEST_TURN, Result
from .robot_fit import HandEye, Tool


def of_tool(found: Tool, told: np.ndarray, now: datetime) -> Result:
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
    return Result('robot-tcp', '', stamp(now), text, values, evidence, [], refuses)


def of_hand_eye(found: HandEye, on_torch: np.ndarray, mounted: np.ndarray, now: datetime) -> Result:
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
    return Result('hand-eye', '', stamp(now), text, values, evidence, [], refuses)


def scan_parameters(on_torch: np.ndarray) -> list[str]:
    """Parameters of scan_fusion for the scanner (4, 4) on the torch."""
    xyz = ', '.join(f'{v:.6f}' for v in on_torch[:3, 3])
    rpy = ', '.join(f'{v:.6f}' for v in wpr(on_torch))
    return [f'scan_fusion: mount_xyz: [{xyz}], mount_rpy: [{rpy}]']
