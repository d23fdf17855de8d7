"""`waam lab`: predicts what will come out, before metal is laid."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from waam_job.cli_program import FINISH_HELP, FINISHES, PART_HELP, add_loop_mode, add_program
from waam_node import spread
from waam_plan import cli_shaft
from waam_process.operating import DEFAULT_MATERIAL, DEFAULT_PRESET, GANTRY, MACHINES, PRESETS

from . import cli_fit, cli_forecast

EXAMPLES = """\
examples:
  waam lab jaw_nominal.stl --as-found jaw_worn.stl                     20 simulated cells, all cores
  waam lab part.stl --as-found worn.stl --tolerance 0.15 --seeds 50    a narrower tolerance, more cells
  waam lab part.stl --as-found worn.stl --loop-mode open_loop          what it would be without correction
  waam lab bracket.stl --mode build --layers 8 --seeds 1,7,11          chosen seeds
  waam lab part.stl --as-found worn.stl --layer-height 1.2 --set correction_server.law=unet
  waam lab part.stl --as-found worn.stl --set cell.metal_transfer=0.88 --set plan.levels=adaptive
  waam lab part.stl --as-found worn.stl --cell-file mycell.yaml        a cell with other physics
  waam lab part.stl --as-found worn.stl --preset gentle                a cell that scatters less than recorded ones do
  waam lab part.stl --as-found worn.stl --machine robot                the same job on a robot
  waam lab part.stl --as-found worn.stl --machine robot --urdf my_arm.urdf   on another arm
  waam lab pad.gcode --dialect slicer --nominal pad.stl                what a program of another slicer will give
  waam lab worn.npz --shaft 80 --ends 20                               a worn shaft that turns (docs/planning.md)
  waam lab fit jobs                                                    fit the cell to records (waam lab fit --help)

--set takes parameters of the nodes (their READMEs list them) and, as plan.NAME, settings of the planner in SI.
--cell-file is a ROS parameter file with the keys of waam_sim/config/cell.yaml; what it leaves out stays as it is.

Written to --out: report.html (open it in a browser), report.json, maps.npz; with --keep-jobs the job folders, for
waam report and waam replay.
The same seed gives the same figures, whatever the number of workers and machines. A worker that is lost costs its
own job, which is run again. A campaign that was ended (Ctrl-C, power) goes on with the same command and its --out: jobs
that are done are not run again.

exit status: 0 all jobs ran, 1 at least one job failed, 2 refused, 130 ended with Ctrl-C
"""


def register(
    commands: argparse._SubParsersAction,
    of_cell: Callable[[str], tuple[dict[str, dict[str, Any]], str, str]] | None = None,
    jobs_dir: Callable[[str], Path] | None = None,
) -> None:
    """Adds the verb `lab`. of_cell: of a cell ('' = the one that is meant) parameters by node, wire and name of its
    file, by that file; ({}, '', '') where there is none. It raises ValueError. jobs_dir: where a cell has
    its jobs, and with them the forecasts."""
    p = commands.add_parser(
        'lab',
        help='predict what will come out: the whole job on many simulated cells, in seconds',
        description='Runs a job on many simulated cells without ROS: RMS, share in tolerance, time and wire as bands.',
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_part(p)
    _add_process(p)
    _add_campaign(p)
    p.set_defaults(run_command=_run, of_cell=of_cell)
    cli_fit.register(commands)
    p = cli_forecast.register(commands, _add_part)
    _add_process(p)
    p.set_defaults(of_cell=of_cell, jobs_dir=jobs_dir)


def _add_part(p: argparse.ArgumentParser) -> None:
    p.add_argument('part', type=Path, help=PART_HELP)
    add_program(p)
    p.add_argument('--as-found', type=Path, help='mesh or cloud of the worn part on the table')
    cli_shaft.add_shaft(p)
    p.add_argument(
        '--mode', choices=('restore', 'build'), help='default: restore with --as-found, else build'
    )
    p.add_argument(
        '--material',
        default='',
        help=f'key of the material table (default: that of the cell file, else {DEFAULT_MATERIAL})',
    )
    p.add_argument('--scale', type=float, default=1e-3, help='metres per unit of both files')
    p.add_argument('--repair', action='store_true', help='close holes of the mesh')
    p.add_argument('--finish', choices=FINISHES, help=FINISH_HELP)
    p.add_argument('--allowance', type=float, default=0.0, metavar='MM', help='left for machining')


def _add_process(p: argparse.ArgumentParser) -> None:
    add_loop_mode(p)
    p.add_argument('--tolerance', type=float, default=0.2, metavar='MM', help='default 0.2')
    p.add_argument('--layer-height', type=float, default=0.0, metavar='MM')
    p.add_argument('--bead-width', type=float, default=0.0, metavar='MM')
    p.add_argument('--layers', type=int, default=0, help='at most so many; 0 = as many as needed')
    p.add_argument('--passes', type=int, default=1, help='2 = plan again after half of the layers')
    p.add_argument('--strategy', default='', help='how layers are filled (waam plan --help)')
    p.add_argument(
        '--k-gain', type=float, default=float('nan'), help='authority of the speed correction'
    )
    p.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NODE.PARAMETER=VALUE',
        help='parameter of a node, or plan.NAME=VALUE (repeatable)',
    )
    known = p.add_mutually_exclusive_group()
    known.add_argument('--fresh', action='store_true', help='start as the first job (default)')
    known.add_argument(
        '--learned',
        type=Path,
        metavar='FOLDER',
        help='start with what jobs have taught, as in jobs/learned; nothing is added. Cell: '
        "'simulated', or --set job_sequencer.cell=NAME",
    )
    p.add_argument(
        '--cell',
        metavar='NAME',
        help='cell whose file (waam cell) says axes, limits and work zero of the simulated machine, and the wire '
        '(default: $WAAM_CELL, or cell, where it has a file); --cell-file and --set win',
    )
    p.add_argument(
        '--cell-file', type=Path, help='physics of the simulated cell: its parameters (YAML)'
    )
    p.add_argument(
        '--preset',
        choices=PRESETS,
        default=DEFAULT_PRESET,
        help=f'how rough the cell is (default: {DEFAULT_PRESET}); --cell-file and --set win',
    )
    p.add_argument(
        '--machine',
        choices=MACHINES,
        default=GANTRY,
        help='what moves the torch: the gantry (default), or a six-axis arm before a positioner, with the servos, the '
        'latency and the errors of cell.robot_*',
    )
    p.add_argument(
        '--urdf',
        type=Path,
        metavar='FILE',
        help='with --machine robot: another arm, for bridge and cell: six revolute joints between its links part and '
        'torch (waam_robot_bridge/README.md)',
    )


def _add_campaign(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        '--seeds', default='20', help='N for 1 .. N (default 20), or a list such as 3-6,11'
    )
    spread.add_options(p)
    p.add_argument(
        '--out', type=Path, help='folder of the report (default: jobs/<time>_lab-<part>)'
    )
    p.add_argument('--keep-jobs', action='store_true', help='keep the folder of every job')


def _run(args: argparse.Namespace) -> int:
    from .cli_campaign import run_campaign

    return run_campaign(args)
