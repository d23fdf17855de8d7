"""What the report needs of a stored plan (plan.npz of a job)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from waam_process.safe_files import parse_json, read_npz


class PlanFileError(ValueError):
    """A file that is no plan; the text names it."""


def read_settings(path: Path | str) -> dict[str, Any]:
    """Settings that a stored plan was made with. Raises PlanFileError."""
    try:
        settings = parse_json(str(read_npz(Path(path))['about']), 'about')['settings']
    except (KeyError, TypeError, ValueError) as error:
        raise PlanFileError(f'{path}: not a stored plan ({error})') from None
    if not isinstance(settings, dict):
        raise PlanFileError(f'{path}: not a stored plan (no settings)')
    return settings
