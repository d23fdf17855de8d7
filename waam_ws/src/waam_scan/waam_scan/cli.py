"""`waam scan`: maps from recorded profiles, and pictures of maps."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from . import cli_register

FUSE_EPILOG = """\
PATH is a recorded job, a folder with the recording of a wall, a pass of a scanner with poses, or a cloud.

A recorded job is its folder, the folder of its record, or an .mcap file: profile batches and telemetry. Every scan
(profiles without a pause of more than a second) gives a map of its own, scan_000 ..., with the mounting that the job
used unless --calibration or --mount says otherwise.

A pass (.npz) holds profiles and poses: stamps (n,) int64 ns, x and z (n, m) in m, NaN = no return; pose_stamps (k,)
int64 ns, poses (k, 3) in m of the wire tip, work frame. Where the scanner sits comes from --calibration (a file of
waam scan calibrate) or --mount. All passes go into one map, in whatever direction they ran. A cloud (.pcd, .ply,
.xyz, .npy) gives one map each; --scale tells its unit.

A folder holds one recording of a wall:
  LaserCoordinate1.csv, LaserCoordinate2.csv ...  raw profiles: TimeReceived,X,Z,Intensity; the points of a profile are
                      space-separated, in mm. 1 is the scan before the first layer, 2 the one after it, and so on.
  arc_log.csv         the robot's log: time (minute:second.tenth), x, y, z in mm, speed and WFS in m/min, ArcOn, I, U

From these it finds out when and where the robot scanned, how far the two clocks are apart, where the scanner sits
beside the torch and where the substrate is (the README of waam_scan says how), and writes per scan
  scan_000.npz ...    z, sigma, count, origin, resolution (m; NaN = never seen), the format of jobs/*/layers
  scan_000.png ...    the map and the bead top along the wall
and with --ply the surface for other tools. Heights are above the substrate.

examples:
  waam scan fuse ../shared/data/wall_profiles
  waam scan fuse recordings/monday recordings/tuesday --out maps --cell 0.5 --ply
  waam scan fuse jobs/latest --cell 0.5
  waam scan fuse pass_1.npz pass_2.npz --calibration calibration.yaml --cell 0.25
  waam scan fuse wall.pcd --cell 0.5 --fill 2
What is bad is left out by name and the rest goes on: a line that cannot be read, a profile of one point or of less than
a tenth of the usual number, a scan without returns, telemetry or motion. Each is said with file, line (or profile,
counted from 0) and reason, with the count at the end. Only when nothing is left it fails.

A cell smaller than the way between two profiles leaves gaps: nothing is filled in unless --fill says up to which
area; what was filled is then marked in the map (array "filled", count 0, no sigma) and hatched in the picture. """
FILTER_EPILOG = """\
FILE is a table with the columns Layer, ScanID, Timestamp (s), SensorTimestamp, PointNr, X, Z (mm), one point per
line, as measured beside the burning arc. Every profile is cut where neighbouring points jump; the piece that fits
what was seen before gives the crown of the bead, and a causal filter joins the crowns. Writes
  NAME_filtered.csv   time, median of the profile, crown, its uncertainty, filtered height, its uncertainty, used
  NAME_filtered.png   points, and the series beside a running median
and compares spikes, noise, correlation of neighbours and delay with a plain median filter.

example:
  waam scan filter ../shared/data/inprocess_profiles/Representative_Layer_raw_points.csv --out maps
"""
PICTURE_EPILOG = """\
examples:
  waam scan picture jobs/latest/layers/scan_003.npz                  writes scan_003.png beside it
  waam scan picture maps/scan_002.npz --png wall.png --ply wall.ply --range -0.5 7
"""
INFO_EPILOG = """\
Knows maps and passes (.npz), clouds (.pcd, .ply, .xyz, .npy), LaserCoordinateN.csv (raw profiles), arc_log.csv (robot
log) and profiles measured beside the arc (Layer,ScanID,Timestamp,SensorTimestamp,PointNr,X,Z, one point per line).

example:
  waam scan info ../shared/data/wall_profiles/LaserCoordinate2.csv jobs/latest/layers/scan_000.npz
"""


def register(commands: argparse._SubParsersAction) -> None:
    """Adds the verb `scan` to the sub-parsers of the waam command."""
    scan = commands.add_parser('scan', help='height maps from laser profiles, and pictures of them')
    verbs = scan.add_subparsers(dest='verb', metavar='VERB', required=True)
    fuse = _leaf(
        verbs, 'fuse', 'recorded jobs, profiles with poses, or clouds -> height maps', FUSE_EPILOG
    )
    fuse.add_argument(
        'paths',
        nargs='+',
        type=Path,
        metavar='PATH',
        help='recorded job, folder of a wall, passes, clouds',
    )
    fuse.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help='where to write (default: maps/<name of the recording>, maps for files)',
    )
    fuse.add_argument(
        '--cell',
        type=_cell_mm,
        default=1.0,
        metavar='MM',
        help='edge of a cell in mm (default 1.0)',
    )
    fuse.add_argument('--ply', action='store_true', help='also write the surface as PLY mesh (mm)')
    _add_fuse_options(fuse)
    fuse.set_defaults(run_command=run_fuse)
    sift = _leaf(
        verbs, 'filter', 'profiles from beside the arc -> bead height over time', FILTER_EPILOG
    )
    sift.add_argument('files', nargs='+', type=Path, metavar='FILE')
    sift.add_argument('--out', type=Path, default=Path('maps'), metavar='DIR', help='default: maps')
    sift.add_argument(
        '--height', action='store_true', help='Z of the file grows upwards (default: a distance)'
    )
    sift.set_defaults(run_command=run_filter)
    picture = _leaf(verbs, 'picture', 'a map file as PNG picture or PLY surface', PICTURE_EPILOG)
    picture.add_argument('map', type=Path, help='NPZ file of a map')
    picture.add_argument('--png', type=Path, help='picture to write (default: beside the map)')
    picture.add_argument('--ply', type=Path, help='PLY mesh to write (mm)')
    picture.add_argument(
        '--range', nargs=2, type=float, metavar=('LOW', 'HIGH'), help='colour range in mm'
    )
    picture.set_defaults(run_command=run_picture)
    info = _leaf(verbs, 'info', 'what a file of profiles, a robot log or a map holds', INFO_EPILOG)
    info.add_argument('files', nargs='+', type=Path, metavar='FILE')
    info.set_defaults(run_command=run_info)
    cli_register.add_commands(verbs)


def _add_fuse_options(fuse: argparse.ArgumentParser) -> None:
    fuse.add_argument('--calibration', type=Path, metavar='FILE', help='where the scanner sits')
    fuse.add_argument(
        '--mount', nargs=6, type=float, metavar=('X', 'Y', 'Z', 'ROLL', 'PITCH', 'YAW'),
        help='the same in mm and degrees (default 60 0 120 0 0 90, for a recorded job: what it used)',
    )  # fmt: skip
    fuse.add_argument(
        '--scale',
        type=float,
        default=1e-3,
        metavar='M',
        help='m per unit of clouds (default 0.001: mm)',
    )
    fuse.add_argument(
        '--fill',
        type=float,
        default=0.0,
        metavar='MM2',
        help='fill holes up to this area in mm² (default 0: none)',
    )


def _leaf(
    verbs: argparse._SubParsersAction, name: str, text: str, epilog: str
) -> argparse.ArgumentParser:
    return verbs.add_parser(
        name,
        help=text,
        description=text,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def _cell_mm(text: str) -> float:
    value = float(text)
    if not 0.05 <= value <= 10.0:
        raise argparse.ArgumentTypeError(f'{text} mm is outside 0.05 .. 10 mm')
    return value


def _guarded(action: Callable[[], None]) -> int:
    """Runs an action; bad input is one clear line and status 1."""
    try:
        action()
    except (ValueError, OSError) as e:
        print(f'error: {e}', file=sys.stderr)
        return 1
    return 0


def run_fuse(args: argparse.Namespace) -> int:
    """A map per record and folder, one of all single files. What is bad is left out by name. Exit status: 0, or 1 with
    the reason on stderr when nothing is left."""
    from .commands.fuse_files import check_paths, fuse_files, fuse_record
    from .commands.wall_report import fuse_folder
    from .recordings.left_out import LeftOut, tell
    from .recordings.scan_records import record_files

    def action() -> None:
        options, cell = _fuse_options(args), args.cell * 1e-3
        check_paths(args.paths)
        left_out, made = LeftOut(), 0
        recorded = [p for p in args.paths if record_files(p)]
        files = [p for p in args.paths if not p.is_dir() and p not in recorded]
        for path in args.paths:
            out = args.out or Path('maps') / path.resolve().stem
            if args.out and len(args.paths) > 1:
                out = args.out / path.resolve().stem
            try:
                if path in recorded:
                    made += fuse_record(path, out, cell, options, left_out)
                elif path.is_dir():
                    fuse_folder(path, out, cell, args.ply, left_out)
                    made += 1
            except ValueError as e:
                if len(args.paths) == 1:
                    raise
                left_out.add('scan', path, '', e)
        if files:
            made += fuse_files(files, args.out or Path('maps'), cell, options, left_out)
        if not made:
            raise left_out.nothing_left(', '.join(map(str, args.paths)))
        tell(left_out)

    return _guarded(action)


def _fuse_options(args: argparse.Namespace) -> argparse.Namespace:
    """What scan_files.fuse_files wants, in SI."""
    import math

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
    return argparse.Namespace(
        scale=args.scale, mounting=mounting, fill=args.fill * 1e-6, ply=args.ply
    )


def run_filter(args: argparse.Namespace) -> int:
    """Filters recorded profiles file by file. What is bad is left out by name. Exit status: 0, or 1 with the reason on
    stderr when nothing is left."""
    from .commands.inprocess_report import filter_file
    from .recordings.left_out import LeftOut, tell

    def action() -> None:
        left_out, made = LeftOut(), 0
        for path in args.files:
            try:
                filter_file(path, args.out, not args.height, left_out)
                made += 1
            except ValueError as e:
                left_out.add('file', path, '', e)
        if not made:
            raise left_out.nothing_left(', '.join(map(str, args.files)))
        tell(left_out)

    return _guarded(action)


def run_picture(args: argparse.Namespace) -> int:
    """PNG and PLY of a stored map; PNG when none is asked for. Exit status: 0, or 1 with the reason on stderr."""
    from .commands.picture import save_ply, save_png
    from .recordings.files import load_map

    def action() -> None:
        grid = load_map(args.map)
        png = args.png or (None if args.ply else args.map.with_suffix('.png'))
        if png:
            save_png(png, grid.spec, grid.z, args.map.stem, args.range)
            print(png)
        if args.ply:
            save_ply(args.ply, grid.spec, grid.z)
            print(args.ply)

    return _guarded(action)


def run_info(args: argparse.Namespace) -> int:
    """One line per file; one that cannot be read is named and the rest goes on. Exit status: 0, or 1 when none can."""
    from .commands.file_info import describe
    from .recordings.left_out import LeftOut, tell

    def action() -> None:
        left_out, told = LeftOut(), 0
        for path in args.files:
            try:
                print(f'{path}: {describe(path, left_out)}')
                told += 1
            except ValueError as e:
                left_out.add('file', path, '', e)
        if not told:
            raise left_out.nothing_left(', '.join(map(str, args.files)))
        tell(left_out)

    return _guarded(action)
