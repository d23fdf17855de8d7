"""`waam commission`: from the plugged-in board to the first corrected part, step by step."""

from __future__ import annotations

from pathlib import Path

from waam_process.cli_options import Verbs, add_verb

from .cli_cell import NAME
from .cli_common import late

TEXT = """\
Leads through the commissioning of a real cell, one step after the other: link, settings, emergency stop, limit
switches, sensors, directions, homing, gas, steps per mm, squareness, wire wheel, pyrometer, resonance, scanner, first
arc, lead of the wire, beads, first corrected part. Each step measures, compares with its limits, and is kept with its
date; a step is done only when those that it stands on have passed. The first one that fails ends the run and says what
to mend. Called again it goes on where it stopped. After the scanner the graph is started once more.

The graph must be up: waam cell new NAME, edit the file, waam up --cell NAME. Every motion and every current is
announced, and begins only after a yes. The software does not replace the emergency stop: keep a hand at it."""
EXAMPLES = """\
examples:
  waam commission gantry1              goes on with the first step that has not passed
  waam commission gantry1 --list       all steps, their state and date; asks and moves nothing
  waam commission gantry1 --step estop this step again; steps that stand on it are out of date then
  waam commission gantry1 --page       writes the page to print and sign
  waam commission gantry1 --answers FILE

An answer file is YAML, one line a question: `directions.x: +x`, `wire.pieces: [341, 340.5, 341.5]`. What is to be done
by hand is printed and waited for. With --json every line out is an object: `say` with `book`, `ask` or `do`; each line
in is {"answer": TEXT}, also to what is to be done. The end of the input ends the run as Ctrl-C does.
Results lie in calibrations/ (or $WAAM_CALIBRATIONS) of the cell: commission/book.yaml, page.html and scanner.yaml, and
steps per mm, squareness, wire, resonance and lead as `waam calibrate` keeps them.
Exit status: 0 all steps passed (or the one asked for), 1 a step failed, 2 refused or not ready."""


def register(commands: Verbs) -> None:
    """Adds the verb."""
    p = add_verb(
        commands, 'commission', 'step by step from the plugged-in board to the first corrected part', NAME,
        ('--list', False, 'show all steps with their state; nothing is asked or moved'),
        ('--step', str, 'only this step, once more', 'NAME'),
        ('--page', False, 'write the page with all steps, dates and a line to sign'),
        ('--yes', False, 'yes to questions of steps in which nothing moves and no current flows'),
        ('--answers', Path, 'answers from a YAML file instead of the keyboard', 'FILE'),
        ('--json', False, 'for a program, as the page Commissioning of the panel: lines of JSON out and in'),
        ('--run', Path, 'folder of the running graph (default: jobs/.run or $WAAM_RUN)'),
        ('--domain', int, 'ROS_DOMAIN_ID (default: from the environment or the folder)'),
        description=TEXT, epilog=EXAMPLES,
    )  # fmt: skip
    p.set_defaults(run_command=late('commission', 'commission'))
