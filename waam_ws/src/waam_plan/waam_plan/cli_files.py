"""What waam plan prints and writes: table, program, picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from . import cli_robot

if TYPE_CHECKING:  # loaded only when a verb needs it
    import argparse

    from .plan import Plan


def write(plan: Plan, args: argparse.Namespace) -> None:
    """Prints the table of the plan and writes what the arguments ask for. ValueError: there is nothing to deposit."""
    from waam_plan.gcode.program import gcode, to_csv
    from waam_plan.gcode.store import save_plan
    from waam_plan.preview.page import write_page
    from waam_plan.preview.picture import draw, table

    print(table(plan))
    for text in plan.remarks:
        print(text)
    for text in plan.warnings:
        print(f'warning: {text}')
    if not plan.layers:
        raise ValueError('nothing to deposit')
    if args.out:
        args.out.mkdir(parents=True, exist_ok=True)
        (args.out / 'program.gcode').write_text(gcode(plan))
        (args.out / 'segments.csv').write_text(to_csv(plan))
        if args.post == 'gcode-compact':
            _write_compact(plan, args.out, args.tolerance)
        if args.post in cli_robot.POSTS:
            cli_robot.write_robot(plan, args)
        save_plan(plan, args.out / 'plan.npz')
    if args.preview or args.out:
        folder = args.out or Path('.')
        draw(plan, folder / 'preview.png')
        write_page(plan, folder / 'preview.html')
    if args.out:
        print(f'written: {args.out}')
    elif args.preview:
        print(f'written: {Path("preview.png").resolve()}, preview.html')


def _write_compact(plan: Plan, folder: Path, tolerance: float | None) -> None:
    """tolerance: mm"""
    from waam_plan.gcode.compact import TOLERANCE
    from waam_plan.gcode.program import compact_gcode

    text, s = compact_gcode(plan, TOLERANCE if tolerance is None else tolerance * 1e-3)
    (folder / 'compact.gcode').write_text(text)
    print(f'compact.gcode: {s.after} moves instead of {s.before}, {s.share:.0%} saved')
