"""What the jobs of a cell have taught (`waam_process.learned`), on disk: read before a job, written after one that
ended in order. A file that cannot be used is never lost: the job goes on without it, and it is moved aside before
another one takes its place.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from waam_node.files import write_atomically
from waam_process.learned import Learned, LearnedError, nothing, parse, plain
from waam_process.safe_files import FileError, Missing, read_text


def file_name(text: str) -> str:
    """Fit for a file or a folder; '' and what is only dots become '_'."""
    name = re.sub(r'[^A-Za-z0-9._-]+', '-', text)[:80].strip('.')
    return name or '_'


def read(path: Path) -> Learned:
    """LearnedError names the file and what is wrong with it. FileNotFoundError when there is none."""
    try:
        return parse(read_text(path))
    except Missing:
        raise
    except FileError as e:
        raise LearnedError(str(e)) from None
    except LearnedError as e:
        raise LearnedError(f'{path}: {e}') from None


@dataclass(frozen=True)
class LearnedFile:
    """learned/<cell>/<material>_<regime>.json."""

    path: Path
    cell: str
    material: str
    regime: str

    @classmethod
    def of(cls, folder: Path, cell: str, material: str, regime: str) -> LearnedFile:
        """The file of a cell, material and regime in the folder of all of them."""
        cell, material = plain(cell), plain(material)
        name = f'{file_name(material)}_{file_name(regime)}.json'
        return cls(folder.resolve() / file_name(cell) / name, cell, material, regime)

    def read(self) -> tuple[Learned, str]:
        """What was learned, and why the file cannot be used, '' when it can or when there is none. Never raises."""
        fresh = nothing(self.cell, self.material, self.regime)
        try:
            found = read(self.path)
        except FileNotFoundError:
            return fresh, ''
        except LearnedError as e:
            return fresh, str(e)
        for name in ('cell', 'material', 'regime'):
            own, its = getattr(self, name), getattr(found, name)
            if own != its:
                return fresh, f"{self.path}: it is of {name} '{its}', not '{own}'"
        return found, ''

    def write(self, learned: Learned, job_id: str) -> str:
        """Replaces the file as a whole. Returns what else an operator should know, ''. OSError when it cannot."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        said = ''
        if self.read()[1]:
            aside = self.path.with_name(f'{self.path.name}.{file_name(job_id)}.bad')
            self.path.replace(aside)
            said = f'what could not be used was kept as {aside}'
        write_atomically(self.path, learned.text())
        return said
