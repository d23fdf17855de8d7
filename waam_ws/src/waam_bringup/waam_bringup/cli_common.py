"""What the verbs of the waam command share."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_run(p: argparse.ArgumentParser) -> None:
    """Options --run and --domain, which name a graph."""
    p.add_argument(
        '--run', type=Path, help='folder of the running graph (default: jobs/.run or $WAAM_RUN)'
    )
    p.add_argument(
        '--domain', type=int, help='ROS_DOMAIN_ID (default: from the environment or the folder)'
    )


def run_and_domain(args: argparse.Namespace) -> tuple[Path, int]:
    """Folder and ROS domain of the graph that is meant: a running graph's domain counts, unless --domain is given."""
    from .operate import default_domain
    from .paths import run_dir
    from .run_state import load

    run = (args.run or run_dir()).resolve()
    state = load(run)
    if args.domain is not None:
        return run, args.domain
    return run, state.domain if state and state.alive else default_domain(run)
