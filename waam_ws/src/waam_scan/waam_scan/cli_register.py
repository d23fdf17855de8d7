"""`waam scan calibrate | register | compare`: where the scanner sits, where the part lies, what metal is missing."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

CALIBRATE_EPILOG = """\
ARTEFACT.yaml describes a body of known shape on the table and where it stands in work coordinates, in mm:
  kind: block                     a truncated pyramid: one artefact that shows everything
  top_mm: [20, 14]                size of its top (x, y); a slope of 45 deg on every side, or  slope_deg: [40, 50]
  height_mm: 12
  position_mm: [100, 60, 0]       of the middle of its foot; touch it off with the wire
  position_sigma_mm: 0.01         how well that is known; .inf = not at all (then the offset cannot be observed)
  yaw_deg: 0                      with  yaw_sigma_deg: 0.01
or
  kind: spheres                   balls on the table, three at different heights or one scanned from many places
  spheres: [{center_mm: [0, 0, 15], radius_mm: 10}, ...]   relative to position_mm

SCAN is the folder or .mcap file of a recording (every scan in it is a pass), or a file .npz with one pass:
stamps (n,) int64 ns, x and z (n, m) in m, NaN = no return, of the profiles;
pose_stamps (k,) int64 ns, poses (k, 3) in m of the wire tip, work frame. Scan with passes both ways and across, at two
heights: passes in one direction only cannot tell the time offset from the position, and the program says so.

examples:
  waam scan calibrate block.yaml pass_*.npz --out calibration.yaml
  waam scan calibrate block.yaml jobs/latest
  waam scan calibrate spheres.yaml pass_*.npz --start-xyz 60 0 120 --start-rpy 0 0 90
Refuses when the motion does not observe the pose, and names the direction.
--accept-unobserved keeps the start value there.
"""
REGISTER_EPILOG = """\
Finds the rigid motion that brings SCAN onto the reference: an earlier scan (drift, distortion) or the nominal STL
(placement of the part). Metal that was added or is missing is not taken for motion. What a flat or round surface
cannot show (sliding on a plane, turning about the axis of a shaft) is left unmoved and named.
SCAN: PLY, PCD or NPY cloud (--scale: m per unit, default 0.001 = mm) or a map (.npz, in m).
With three or more clouds, or --sequence: a scanner whose poses are missing (hand-held, carried by a robot); every cloud
is placed against the map of those before (KISS-ICP, then refined), a trajectory and one cloud are written.

examples:
  waam scan register scan_004.npz scan_003.npz                   drift since the last layer, new metal allowed
  waam scan register found.ply roller.stl --search --change wear placed anywhere on the table, worn
  waam scan register frame_*.ply --out track
Writes registration.json (transform, uncertainty, what is unobserved), registration.png and, with --moved, the cloud.
"""
COMPARE_EPILOG = """\
The metal that is missing between the scan and the nominal surface, looking down: what a restoration must add.
SCAN and NOMINAL must be in the same coordinates; --register aligns first (see waam scan register).

examples:
  waam scan compare roller.stl found.ply --register --allowance 1.0 --out wear
  waam plan roller.stl --as-found wear/as_found.npz --set allowance=0.001
Writes missing.npz (z = missing metal, nominal, found; m), as_found.npz (the worn surface in the planner's frame),
missing.png and missing.json (volume with uncertainty, bounding box, deepest place, regions, share not seen).
"""


def add_commands(subparsers: argparse._SubParsersAction) -> None:
    """Adds calibrate, register and compare to the sub-parsers of `waam scan`."""
    _add_calibrate(subparsers)
    _add_register(subparsers)
    _add_compare(subparsers)


def _leaf(
    subparsers: argparse._SubParsersAction, name: str, text: str, epilog: str
) -> argparse.ArgumentParser:
    return subparsers.add_parser(
        name,
        help=text,
        description=text,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def _add_calibrate(subparsers: argparse._SubParsersAction) -> None:
    p = _leaf(
        subparsers,
        'calibrate',
        'scanner pose and time offset from scans of a known artefact',
        CALIBRATE_EPILOG,
    )
    p.add_argument('artefact', type=Path, metavar='ARTEFACT', help='YAML file of the artefact')
    p.add_argument(
        'scans', type=Path, nargs='+', metavar='SCAN', help='recording or NPZ file of one pass'
    )
    p.add_argument(
        '--out', type=Path, default=Path('calibration.yaml'), help='default calibration.yaml'
    )
    p.add_argument(
        '--start-xyz',
        nargs=3,
        type=float,
        default=(60.0, 0.0, 120.0),
        metavar='MM',
        help='scanner origin from the wire tip, roughly (default 60 0 120)',
    )
    p.add_argument(
        '--start-rpy',
        nargs=3,
        type=float,
        default=(0.0, 0.0, 90.0),
        metavar='DEG',
        help='its roll, pitch, yaw, roughly (default 0 0 90)',
    )
    p.add_argument(
        '--start-delay',
        type=float,
        default=0.0,
        metavar='MS',
        help='added to profile stamps, roughly (default 0)',
    )
    p.add_argument(
        '--accept-unobserved',
        action='store_true',
        help='keep the start value where the scans show nothing, instead of refusing',
    )
    p.set_defaults(run_command=run_calibrate)


def _add_change(p: argparse.ArgumentParser, default: str) -> None:
    p.add_argument(
        '--change',
        choices=('growth', 'wear', 'any'),
        default=default,
        help='how SCAN may differ besides the motion: metal was added, is missing, or either '
        f'(default {default})',
    )
    p.add_argument(
        '--scale', type=float, default=1e-3, help='m per unit of clouds and meshes, default 0.001'
    )
    p.add_argument(
        '--reach',
        type=float,
        default=3.0,
        metavar='MM',
        help='largest motion to look for (default 3)',
    )
    p.add_argument('--seed', type=int, default=0, help='of the choice of points (default 0)')


def _add_register(subparsers: argparse._SubParsersAction) -> None:
    p = _leaf(
        subparsers,
        'register',
        'the motion between two scans, or of a scan against its nominal STL',
        REGISTER_EPILOG,
    )
    p.add_argument('clouds', type=Path, nargs='+', metavar='SCAN', help='SCAN REFERENCE, or frames')
    _add_change(p, 'growth')
    p.add_argument(
        '--search',
        action='store_true',
        help='the part may lie anywhere, turned about z by any angle',
    )
    p.add_argument('--sequence', action='store_true', help='frames without poses: odometry')
    p.add_argument(
        '--voxel', type=float, default=0.5, metavar='MM', help='of the odometry (default 0.5)'
    )
    p.add_argument('--out', type=Path, default=Path('registration'), help='folder for the results')
    p.add_argument('--moved', action='store_true', help='also write the moved cloud as PLY (mm)')
    p.set_defaults(run_command=run_register)


def _add_compare(subparsers: argparse._SubParsersAction) -> None:
    p = _leaf(
        subparsers,
        'compare',
        'missing metal between a scan and the nominal STL, for the planner',
        COMPARE_EPILOG,
    )
    p.add_argument('nominal', type=Path, metavar='NOMINAL', help='mesh: STL, PLY, OBJ or OFF')
    p.add_argument('scan', type=Path, metavar='SCAN', help='cloud or map')
    p.add_argument(
        '--allowance',
        type=float,
        default=0.0,
        metavar='MM',
        help='machining allowance on top of nominal (default 0)',
    )
    p.add_argument(
        '--cell', type=float, default=0.5, metavar='MM', help='edge of a cell (default 0.5)'
    )
    p.add_argument('--register', action='store_true', help='align the scan first')
    p.add_argument(
        '--search',
        action='store_true',
        help='with --register: the part may lie anywhere on the table',
    )
    _add_change(p, 'wear')
    p.add_argument('--out', type=Path, default=Path('compare'), help='folder for the results')
    p.set_defaults(run_command=run_compare)


def _guarded(action: Callable[[argparse.Namespace], int], args: argparse.Namespace) -> int:
    """Bad input is one clear line and status 1."""
    try:
        return action(args) or 0
    except (ValueError, OSError) as error:
        print(f'error: {error}', file=sys.stderr)
        return 1


def run_calibrate(args: argparse.Namespace) -> int:
    """0, or 1 with the reason: bad input, or a motion that does not show the pose."""
    from .commands.calibration_report import calibrate_files

    return _guarded(calibrate_files, args)


def run_register(args: argparse.Namespace) -> int:
    """Exit status: 0, or 1 with the reason on stderr."""
    from .commands.registration_report import register_files

    return _guarded(register_files, args)


def run_compare(args: argparse.Namespace) -> int:
    """Exit status: 0, or 1 with the reason on stderr."""
    from .commands.compare_report import compare_files

    return _guarded(compare_files, args)
