"""Results of a campaign or a fit, kept one by one, so that one that was ended goes on where it was."""

from __future__ import annotations

import hashlib
import os
import pickle
import shutil
from pathlib import Path
from typing import Any

from .job import LabJob, LabResult

TORN = (
    OSError, pickle.UnpicklingError, EOFError, ValueError, AttributeError, TypeError, ImportError,
)  # fmt: skip


class Kept:
    """A folder of this software's own pickles, one per result. A result is known by a text that says all it was made
    from; another text finds nothing."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def found(self, key: str, kind: type[Any]) -> Any:
        """None: not there, torn, of another key, or not of this kind."""
        try:
            known, result = pickle.loads(self.file(key).read_bytes())
        except TORN:
            return None
        return result if known == key and isinstance(result, kind) else None

    def keep(self, key: str, result: Any) -> None:
        """In one step: a killed process leaves the whole piece or none."""
        self.folder.mkdir(parents=True, exist_ok=True)
        file = self.file(key)
        new = file.with_suffix('.new')
        new.write_bytes(pickle.dumps((key, result)))
        os.replace(new, file)

    def clear(self) -> None:
        """The work is complete and its report written."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def file(self, key: str) -> Path:
        """Where the result of this key is or will be."""
        return self.folder / f'{hashlib.sha256(key.encode()).hexdigest()[:20]}.pickle'


class Pieces:
    """Results of the jobs of a campaign. A job is known by everything that it was given: with another seed, parameter,
    mesh or software revision it runs again."""

    def __init__(self, folder: Path, software: str) -> None:
        """software: its revision, of which the results are."""
        self._kept, self.software = Kept(folder), software

    @property
    def folder(self) -> Path:
        """Where they are."""
        return self._kept.folder

    def read(self, job: LabJob) -> LabResult | None:
        """None: not there, torn, or of another job."""
        found: LabResult | None = self._kept.found(self._key(job), LabResult)
        return found

    def write(self, job: LabJob, result: LabResult) -> None:
        """In one step: a killed process leaves the whole piece or none."""
        self._kept.keep(self._key(job), result)

    def clear(self) -> None:
        """The campaign is complete and its report written."""
        self._kept.clear()

    def _key(self, job: LabJob) -> str:
        named = [f for f in (job.goal.part, job.goal.program, job.as_found) if f]
        named += sorted(job.learned.rglob('*.json')) if job.learned else []
        files = [f for f in named if f.is_file()]
        found = [hashlib.sha256(f.read_bytes()).hexdigest() for f in files]
        return repr((self.software, job, found))
