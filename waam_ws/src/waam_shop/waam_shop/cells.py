"""The cells of a shop as their panels tell of them: what is shown at a glance. Pure."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from waam_process.rows import fits
from waam_process.safe_files import FileError, parse_json

FIRST = 'cell'  # name of the cell that has none
NAME = re.compile(r'[a-z][a-z0-9_]{0,30}')
FRESH_S = 5.0  # a cell that has told nothing for longer is silent
MAX_TEXT_LENGTH = 500  # letters of a text
UP, SILENT, DOWN = 'up', 'silent', 'down'


def check_name(name: str) -> str:
    """The name of a cell. Raises ValueError: it must be one of a ROS namespace and of a folder."""
    if not NAME.fullmatch(name):
        raise ValueError(
            f'{name!r} is no name of a cell: a small letter, then small letters, digits and _, at most 31'
        )
    return name


@dataclass(frozen=True)
class CellStatus:
    """What a panel writes once a second. utc: s; machine, job_state: names; alarm: the worst one that nobody has
    acknowledged; queue: counts by state."""

    name: str
    utc: float = 0.0
    host: str = ''
    domain: int = 0
    page: str = ''
    simulated: bool = True
    down: bool = False
    connected: bool = False
    machine: str = ''
    armed: bool = False
    job: str = ''
    job_state: str = ''
    job_message: str = ''
    progress: float = 0.0
    time_left: float | None = None
    layer: int = 0
    layers: int = 0
    alarm: str = ''
    severity: int = 0
    queue: dict[str, int] = field(default_factory=dict, hash=False)
    next: str = ''

    def text(self) -> str:
        """For the file."""
        return json.dumps(asdict(self))

    def state(self, now: float) -> str:
        """up, silent or down. now: UTC, s."""
        if self.down:
            return DOWN
        return UP if abs(now - self.utc) <= FRESH_S else SILENT

    def row(self, now: float) -> dict[str, Any]:
        """For a page or JSON."""
        return asdict(self) | {'state': self.state(now), 'age': round(max(0.0, now - self.utc), 1)}


def parse(name: str, text: str) -> CellStatus:
    """The status of the cell `name` from the text of its file; what is not understood is left at its default."""
    try:
        data = parse_json(text, name)
    except FileError:
        data = None
    if not isinstance(data, dict):
        return CellStatus(name)
    good: dict[str, Any] = {}
    for f in fields(CellStatus):
        value = data.get(f.name)
        if f.name in data and f.name != 'name' and fits(value, str(f.type)):
            good[f.name] = value[:MAX_TEXT_LENGTH] if isinstance(value, str) else value
    return CellStatus(name, **good)
