"""The demo job as real processes on the simulated cell, its output on stderr."""

from __future__ import annotations

import json
import sys
import time
from contextlib import redirect_stdout
from pathlib import Path
from types import SimpleNamespace


def demo(
    jobs: Path, seed: int, modes: tuple[str, ...], preset: str, layers: int = 0
) -> tuple[dict, float]:
    """report.json of the demo's jaw and the wall time in s. layers: 0 = all."""
    from waam_bringup.demo import run_demo
    from waam_node import job_folder

    asked = SimpleNamespace(
        seed=seed, machine='gantry', jobs=jobs, layers=layers, loop_modes=list(modes), rate=0.0, fresh=True,
        preset=preset,
    )  # fmt: skip
    began = time.monotonic()
    with redirect_stdout(sys.stderr):
        run_demo(asked)
    wall = time.monotonic() - began
    return json.loads((jobs / job_folder.LATEST / job_folder.REPORT).read_text()), wall
