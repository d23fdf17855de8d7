"""`waam scan`: maps from recorded profiles, and pictures of maps."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

FUSE_EPILOG = """\
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
A cell smaller than the way between two profiles leaves gaps: nothing is filled in.
"""
PICTURE_EPILOG = """\
examples:
  waam scan picture jobs/latest/layers/scan_003.npz                  writes scan_003.png beside it
  waam scan picture maps/scan_002.npz --png wall.png --ply wall.ply --range -0.5 7
"""
INFO_EPILOG = """\
Knows LaserCoordinateN.csv (raw profiles), arc_log.csv (robot log), profiles measured beside the arc (one point per
line: Layer,ScanID,Timestamp,SensorTimestamp,PointNr,X,Z) and map files (.npz).

example:
  waam scan info ../shared/data/wall_profiles/LaserCoordinate2.csv jobs/latest/layers/scan_000.npz
"""


def register(commands) -> None:
    """Adds the verb `scan` to the sub-parsers of the waam command."""
    scan = commands.add_parser('scan', help='height maps from laser profiles, and pictures of them')
    verbs = scan.add_subparsers(dest='verb', metavar='VERB', required=True)
    fuse = _leaf(
        verbs, 'fuse', 'recorded profiles and robot log -> one height map per scan', FUSE_EPILOG
    )
    fuse.add_argument(
        'paths', nargs='+', type=Path, metavar='FOLDER', help='folder with a recording'
    )
    fuse.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help='where to write (default: maps/<name of the folder>)',
    )
    fuse.add_argument(
        '--cell',
        type=_cell_mm,
        default=1.0,
        metavar='MM',
        help='edge of a cell in mm (default 1.0)',
    )
    fuse.add_argument('--ply', action='store_true', help='also write the surface as PLY mesh (mm)')
    fuse.set_defaults(run=run_fuse)
    picture = _leaf(verbs, 'picture', 'a map file as PNG picture or PLY surface', PICTURE_EPILOG)
    picture.add_argument('map', type=Path, help='NPZ file of a map')
    picture.add_argument('--png', type=Path, help='picture to write (default: beside the map)')
    picture.add_argument('--ply', type=Path, help='PLY mesh to write (mm)')
    picture.add_argument(
        '--range', nargs=2, type=float, metavar=('LOW', 'HIGH'), help='colour range in mm'
    )
    picture.set_defaults(run=run_picture)
    info = _leaf(verbs, 'info', 'what a file of profiles, a robot log or a map holds', INFO_EPILOG)
    info.add_argument('files', nargs='+', type=Path, metavar='FILE')
    info.set_defaults(run=run_info)


def _leaf(verbs, name: str, text: str, epilog: str) -> argparse.ArgumentParser:
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


def _guarded(action, *args) -> int:
    """Runs an action; bad input is one clear line and status 1."""
    try:
        return action(*args) or 0
    except (ValueError, OSError) as e:
        print(f'error: {e}', file=sys.stderr)
        return 1


def run_fuse(args: argparse.Namespace) -> int:
    from .wall_report import fuse_folder

    def action() -> None:
        for path in args.paths:
            out = args.out or Path('maps') / path.resolve().name
            if args.out and len(args.paths) > 1:
                out = args.out / path.resolve().name
            fuse_folder(path, out, args.cell * 1e-3, args.ply)

    return _guarded(action)


def run_picture(args: argparse.Namespace) -> int:
    from .files import load_map
    from .picture import save_ply, save_png

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
    from .file_info import describe

    def action() -> None:
        for path in args.files:
            print(f'{path}: {describe(path)}')

    return _guarded(action)
