"""Results of a campaign, kept one by one, so that a campaign that was ended goes on where it was."""

from __future__ import annotations

import hashlib
import os
import pickle
import shutil
from pathlib import Path

from .job import LabJob, LabResult


class Pieces:
    """A folder of this software's own pickles, one per job that has run. A job is known by everything that it was
    given: with another seed, parameter, mesh or software revision it runs again."""

    def __init__(self, folder: Path, software: str) -> None:
        """software: its revision, of which the results are."""
        self.folder, self.software = folder, software

    def read(self, job: LabJob) -> LabResult | None:
        """None: not there, torn, or of another job."""
        try:
            known, result = pickle.loads(self._file(job).read_bytes())
        except (
            OSError,
            pickle.UnpicklingError,
            EOFError,
            ValueError,
            AttributeError,
            TypeError,
            ImportError,
        ):
            return None
        return result if known == self._key(job) and isinstance(result, LabResult) else None

    def write(self, job: LabJob, result: LabResult) -> None:
        """In one step: a killed process leaves the whole piece or none."""
        self.folder.mkdir(parents=True, exist_ok=True)
        file = self._file(job)
        new = file.with_suffix('.new')
        new.write_bytes(pickle.dumps((self._key(job), result)))
        os.replace(new, file)

    def clear(self) -> None:
        """The campaign is complete and its report written."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _file(self, job: LabJob) -> Path:
        return self.folder / f'seed_{job.seed}-{self._key(job)[:12]}.pickle'

    def _key(self, job: LabJob) -> str:
        named = [f for f in (job.goal.part, job.goal.program, job.as_found) if f]
        named += sorted(job.learned.rglob('*.json')) if job.learned else []
        files = [f for f in named if f.is_file()]
        found = [hashlib.sha256(f.read_bytes()).hexdigest() for f in files]
        return hashlib.sha256(repr((self.software, job, found)).encode()).hexdigest()
