"""What the stored calibrations say against a job: the same reasons as `waam job run` has. No ROS."""

from __future__ import annotations

import asyncio
from pathlib import Path

from waam_calibrate import results, store

from .operations import Refused


async def check(folder: Path | None) -> None:
    """Refused with every reason. folder: of calibration results; None: nothing is known of any."""
    if folder is None:
        return
    kept = await asyncio.to_thread(store.load_all, folder)
    if reasons := results.refusals(kept.results, kept.damaged):
        raise Refused(f'{"; ".join(reasons)} (waam calibrate status)')
