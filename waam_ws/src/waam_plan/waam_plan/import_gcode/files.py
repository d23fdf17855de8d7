"""Programs and dialects on disk."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import yaml

from waam_plan.import_gcode.dialect import Dialect, DialectError, dialect_of
from waam_plan.import_gcode.motion import Program
from waam_plan.import_gcode.reader import read_program
from waam_plan.import_gcode.words import ProgramError
from waam_plan.texts import text_of

FOLDER = Path(__file__).with_name('dialects')
SUFFIXES = ('.gcode', '.gco', '.g', '.nc', '.ngc', '.tap', '.cnc')
MAX_BYTES = 100_000_000
DEFAULT = 'waam'


def is_program(path: Path) -> bool:
    """Whether a file is G-code, by its name."""
    return path.suffix.lower() in SUFFIXES


@cache
def shipped() -> tuple[str, ...]:
    """Names of the dialects that need no file."""
    return tuple(sorted(p.stem for p in FOLDER.glob('*.yaml')))


def dialect_text(name: str) -> str:
    """The YAML of a shipped dialect or of a file. DialectError when there is none."""
    path = FOLDER / f'{name}.yaml' if name in shipped() else Path(name)
    try:
        return path.read_text()
    except (OSError, UnicodeDecodeError) as e:
        known = ', '.join(shipped())
        raise DialectError(f'{name}: no dialect ({known}) and no readable file ({e})') from None


def load_dialect(name: str) -> Dialect:
    """name: of a shipped dialect or of a YAML file; '' = that of our own programs. Raises DialectError."""
    name = name or DEFAULT
    return parse_dialect(dialect_text(name), name)


def parse_dialect(text: str, where: str) -> Dialect:
    """From the YAML itself. Raises DialectError."""
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as e:
        raise DialectError(f'{where}: no YAML ({" ".join(str(e).split())})') from None
    return dialect_of(data, where)


def load_program(path: Path, dialect: str = '') -> Program:
    """Raises ProgramError or DialectError."""
    return read_program(program_text(path), load_dialect(dialect), path.name)


def program_text(path: Path) -> str:
    """What the file holds, in whatever Unicode; other bytes become U+FFFD, for comments only. ProgramError."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ProgramError(f'{path}: larger than {MAX_BYTES // 1_000_000} MB')
        return text_of(path.read_bytes())
    except OSError as e:
        raise ProgramError(f'{path}: {e.strerror or e}') from None
