"""The scanner's calibration as the job sees it: which file, from when, and whether it is too old to start a job on.

The file is that of `waam scan calibrate` (YAML, date, sha256); scan_fusion checks and uses it, the job traces it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from waam_process.safe_files import read_yaml

DAY = 86400.0


@dataclass(frozen=True)
class Calibration:
    """What a calibration file says about itself."""

    file: str = ''  # '' = scan_fusion uses the mounting of its parameters
    date: str = ''  # ISO 8601
    sha256: str = ''
    artefact: str = ''  # what it was measured on
    trouble: str = ''  # why the file says nothing, '' = it does

    def age_days(self, now: datetime) -> float:
        """NaN when no date is known."""
        try:
            made = datetime.fromisoformat(self.date)
        except ValueError:
            return math.nan
        return (now - made.replace(tzinfo=made.tzinfo or UTC)).total_seconds() / DAY


def read(file: str) -> Calibration:
    """What the file says about itself; never raises: `trouble` says why a file cannot be read."""
    if not file:
        return Calibration()
    try:
        data = read_yaml(Path(file))
        date, sha256 = str(data['date']), str(data['sha256'])
        found = Calibration(file, date, sha256, str(data.get('artefact', '')))
    except FileNotFoundError:
        return Calibration(file, trouble='no such file')
    except (ValueError, KeyError, TypeError, AttributeError) as e:
        return Calibration(file, trouble=f'not a calibration file ({type(e).__name__}: {e})')
    if math.isnan(found.age_days(datetime.now(UTC))):
        return Calibration(file, trouble=f"its date '{date}' is none")
    return found


def problem(c: Calibration, max_days: float, simulated: bool, now: datetime) -> str:
    """Why no job may start with it, '' when one may. max_days 0: any age."""
    if c.trouble:
        return f'scanner calibration {c.file}: {c.trouble}'
    if max_days <= 0:
        return ''
    if not c.file:
        text = 'the scanner is not calibrated: scan_fusion has no calibration file (waam scan calibrate)'
        return '' if simulated else text
    age = c.age_days(now)
    if age > max_days:
        return (
            f'the scanner calibration {c.file} is {age:.0f} days old, at most {max_days:g} are allowed '
            '(waam scan calibrate)'
        )
    if age < -1.0:
        return f'the scanner calibration {c.file} is from {-age:.0f} days in the future: is the clock right?'
    return ''


def problem_today(file: str, max_days: float, simulated: bool) -> str:
    """`problem` of the calibration in this file, by the clock of this machine."""
    return problem(read(file), max_days, simulated, datetime.now(UTC))
