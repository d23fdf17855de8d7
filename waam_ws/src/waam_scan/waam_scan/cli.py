"""`waam scan`: maps from recorded profiles, pictures of maps, calibration, registration, missing metal."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from waam_process.cli_options import Verbs, add_verb

FUSE_EPILOG = """\
PATH is a recorded job, a pass of a scanner with poses, or a cloud.

A recorded job is its folder, the folder of its record, or an .mcap file: profile batches and telemetry. Every scan
(profiles without a pause of more than a second) gives a map of its own, scan_000 ..., with the mounting that the job
used unless --calibration or --mount says otherwise. Logs of others: waam record import first.

A pass (.npz) holds profiles and poses: stamps (n,) int64 ns, x and z (n, m) in m, NaN = no return; pose_stamps (k,)
int64 ns, poses (k, 3) in m of the wire tip, work frame. Where the scanner sits comes from --calibration (a file of
waam scan calibrate) or --mount. All passes go into one map, in whatever direction they ran. A cloud (.pcd, .ply,
.xyz, .npy) gives one map each; --scale tells its unit.

Written are per map NAME.npz (z, sigma, count, origin, resolution; m, NaN = never seen: the format of jobs/*/layers),
NAME.png and with --ply the surface for other tools.

examples:
  waam scan fuse jobs/latest --cell 0.5
  waam scan fuse pass_1.npz pass_2.npz --calibration calibration.yaml --cell 0.25
  waam scan fuse wall.pcd --cell 0.5

What is bad is left out by name and the rest goes on: a profile of one point, a scan without returns, telemetry or
motion. Each is said with file, profile (counted from 0) and reason, with the count at the end. Only when nothing is
left it fails.

A cell smaller than the way between two profiles leaves gaps: nothing is filled in.
"""
PICTURE_EPILOG = """\
examples:
  waam scan picture jobs/latest/layers/scan_003.npz                  writes scan_003.png beside it
  waam scan picture maps/scan_002.npz --png wall.png --ply wall.ply --range -0.5 7
"""
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
CHANGES = {'choices': ('growth', 'wear', 'any')}
HOW = 'how SCAN may differ besides the motion: metal was added, is missing, or either'
MOTION = (  # of register and compare
    ('--scale', 1e-3, 'm per unit of clouds and meshes, default 0.001'),
    ('--reach', 3.0, 'largest motion to look for (default 3)', 'MM'),
    ('--seed', 0, 'of the choice of points (default 0)'),
)


def register(commands: Verbs) -> None:
    """Adds the verb `scan` to the sub-parsers of the waam command."""
    scan = commands.add_parser('scan', help='height maps from laser profiles, and pictures of them')
    verbs = scan.add_subparsers(dest='verb', metavar='VERB', required=True)

    def add(name: str, run: Callable[..., None], text: str, epilog: str, *rows: Any) -> None:
        verb = add_verb(verbs, name, text, *rows, epilog=epilog)
        verb.set_defaults(run_command=lambda args: _guarded(run, args))

    add(
        'fuse', fuse, 'recorded jobs, profiles with poses, or clouds -> height maps', FUSE_EPILOG,
        ('paths', Path, 'recorded job, passes, clouds', 'PATH', {'nargs': '+'}),
        ('--out', Path, 'where to write (default: maps/<name of the recording>, maps for files)', 'DIR'),
        ('--cell', 1.0, 'edge of a cell in mm (default 1.0)', 'MM', {'type': _cell_mm}),
        ('--ply', False, 'also write the surface as PLY mesh (mm)'),
        ('--calibration', Path, 'where the scanner sits', 'FILE'),
        ('--mount', float, 'the same in mm and degrees (default 60 0 120 0 0 90; of a recorded job what it used)',
         ('X', 'Y', 'Z', 'ROLL', 'PITCH', 'YAW'), {'nargs': 6}),
        ('--scale', 1e-3, 'm per unit of clouds (default 0.001: mm)', 'M'),
    )  # fmt: skip
    add(
        'picture', picture, 'a map file as PNG picture or PLY surface', PICTURE_EPILOG,
        ('map', Path, 'NPZ file of a map'), ('--png', Path, 'picture to write (default: beside the map)'),
        ('--ply', Path, 'PLY mesh to write (mm)'),
        ('--range', float, 'colour range in mm', ('LOW', 'HIGH'), {'nargs': 2}),
    )  # fmt: skip
    add(
        'calibrate', command('calibration_report', 'calibrate_files'),
        'scanner pose and time offset from scans of a known artefact', CALIBRATE_EPILOG,
        ('artefact', Path, 'YAML file of the artefact', 'ARTEFACT'),
        ('scans', Path, 'recording or NPZ file of one pass', 'SCAN', {'nargs': '+'}),
        ('--out', Path('calibration.yaml'), 'default calibration.yaml', None, {'type': Path}),
        ('--start-xyz', (60.0, 0.0, 120.0), 'scanner origin from the wire tip, roughly (default 60 0 120)', 'MM'),
        ('--start-rpy', (0.0, 0.0, 90.0), 'its roll, pitch, yaw, roughly (default 0 0 90)', 'DEG'),
        ('--start-delay', 0.0, 'added to profile stamps, roughly (default 0)', 'MS'),
        ('--accept-unobserved', False, 'keep the start value where the scans show nothing, instead of refusing'),
    )  # fmt: skip
    add(
        'register', command('registration_report', 'register_files'),
        'the motion between two scans, or of a scan against its nominal STL', REGISTER_EPILOG,
        ('clouds', Path, 'SCAN REFERENCE, or frames', 'SCAN', {'nargs': '+'}),
        ('--change', 'growth', f'{HOW} (default growth)', None, CHANGES), *MOTION,
        ('--search', False, 'the part may lie anywhere, turned about z by any angle'),
        ('--sequence', False, 'frames without poses: odometry'),
        ('--voxel', 0.5, 'of the odometry (default 0.5)', 'MM'),
        ('--out', Path('registration'), 'folder for the results', None, {'type': Path}),
        ('--moved', False, 'also write the moved cloud as PLY (mm)'),
    )  # fmt: skip
    add(
        'compare', command('compare_report', 'compare_files'),
        'missing metal between a scan and the nominal STL, for the planner', COMPARE_EPILOG,
        ('nominal', Path, 'mesh: STL, PLY, OBJ or OFF', 'NOMINAL'), ('scan', Path, 'cloud or map', 'SCAN'),
        ('--allowance', 0.0, 'machining allowance on top of nominal (default 0)', 'MM'),
        ('--cell', 0.5, 'edge of a cell (default 0.5)', 'MM'), ('--register', False, 'align the scan first'),
        ('--search', False, 'with --register: the part may lie anywhere on the table'),
        ('--change', 'wear', f'{HOW} (default wear)', None, CHANGES), *MOTION,
        ('--out', Path('compare'), 'folder for the results', None, {'type': Path}),
    )  # fmt: skip


def _cell_mm(text: str) -> float:
    value = float(text)
    if not 0.05 <= value <= 10.0:
        raise argparse.ArgumentTypeError(f'{text} mm is outside 0.05 .. 10 mm')
    return value


def _guarded(action: Callable[[argparse.Namespace], None], args: argparse.Namespace) -> int:
    """Exit status: 0, or 1 with the reason on stderr in one line."""
    try:
        action(args)
    except (ValueError, OSError) as e:
        print(f'error: {e}', file=sys.stderr)
        return 1
    return 0


def fuse(args: argparse.Namespace) -> None:
    """A map per scan of a record, one of all single files. What is bad is left out by name."""
    from .commands.fuse_files import check_paths, fuse_files, fuse_record
    from .left_out import LeftOut, tell
    from .scan_records import record_files

    options, cell = _fuse_options(args), args.cell * 1e-3
    check_paths(args.paths)
    left_out, made = LeftOut(), 0
    recorded = [p for p in args.paths if p.is_dir() or record_files(p)]
    for path in recorded:
        out = args.out or Path('maps') / path.resolve().stem
        if args.out and len(args.paths) > 1:
            out = args.out / path.resolve().stem
        try:
            made += fuse_record(path, out, cell, options, left_out)
        except ValueError as e:
            if len(args.paths) == 1:
                raise
            left_out.add('scan', path, '', e)
    if files := [p for p in args.paths if p not in recorded]:
        made += fuse_files(files, args.out or Path('maps'), cell, options, left_out)
    if not made:
        raise left_out.nothing_left(', '.join(map(str, args.paths)))
    tell(left_out)


def _fuse_options(args: argparse.Namespace) -> argparse.Namespace:
    """What `fuse_files` wants, in SI."""
    from .transform import Mounting

    mounting = None
    if args.calibration and args.mount:
        raise ValueError('--calibration and --mount contradict each other')
    if args.calibration:
        from .calibration.file import load_calibration

        mounting = load_calibration(args.calibration).mounting
    if args.mount:
        rpy = tuple(math.radians(a) for a in args.mount[3:])
        mounting = Mounting.from_rpy(tuple(v * 1e-3 for v in args.mount[:3]), rpy)
    return argparse.Namespace(scale=args.scale, mounting=mounting, ply=args.ply)


def picture(args: argparse.Namespace) -> None:
    """PNG and PLY of a stored map; PNG when none is asked for."""
    from .commands.picture import save_ply, save_png
    from .map_file import load_map

    grid = load_map(args.map)
    png = args.png or (None if args.ply else args.map.with_suffix('.png'))
    if png:
        save_png(png, grid.spec, grid.z, args.map.stem, args.range)
        print(png)
    if args.ply:
        save_ply(args.ply, grid.spec, grid.z)
        print(args.ply)


def command(module: str, name: str) -> Callable[[argparse.Namespace], None]:
    """A function of `commands`, loaded when it runs."""

    def run(args: argparse.Namespace) -> None:
        getattr(import_module(f'.commands.{module}', __package__), name)(args)

    return run
