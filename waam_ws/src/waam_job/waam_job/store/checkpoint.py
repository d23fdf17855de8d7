"""How far a job has come, on disk after every bead, so that it can go on after a crash or a power cut.

Two generations are kept, each with a check sum: a torn or damaged newest file is reported and the one before is used.
The surface shows what was really laid (resume.py); the checkpoint says what must at least be there.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path

from waam_node.files import write_atomically
from waam_node.job_folder import CHECKPOINT, CHECKPOINT_BEFORE
from waam_process.safe_files import FileError, Missing, parse_json, read_text


@dataclass(frozen=True)
class Checkpoint:
    """State of the deposition. `beads_done` beads of `layer` are complete; `bead` is being laid (0 = none)."""

    job_id: str
    run: int = 1  # 1 = first start, 2 = first resume ...
    pass_number: int = 1
    layer: int = 0
    bead: int = 0
    beads_done: int = 0
    index: int = 0  # last segment that was reported done in this run
    time: float = 0.0  # s, ROS time
    temperature: float | None = None  # degC, what the pyrometer then showed; None = nothing
    # deposit segments of the layer that are complete; None = not written down
    laid: int | None = None

    def text(self) -> str:
        """JSON with a CRC-32 over all fields; `parse` reads it."""
        data = asdict(self)
        return json.dumps({**data, 'crc32': _crc(data)}, indent=1)


def _crc(data: dict) -> int:
    return zlib.crc32(json.dumps(data, sort_keys=True).encode())


class CheckpointError(ValueError):
    """A file that is no checkpoint; the text says which and why."""


def parse(text: str, name: str) -> Checkpoint:
    """Raises CheckpointError when the text is torn, changed or of another kind."""
    try:
        data = parse_json(text, name)
        crc, own = data.pop('crc32'), _crc(data)
        checkpoint = Checkpoint(**data)
    except (ValueError, KeyError, TypeError, AttributeError) as e:
        raise CheckpointError(f'{name}: not a checkpoint ({e or type(e).__name__})') from None
    if crc != own:
        raise CheckpointError(f'{name}: the check sum does not fit, the file is torn or changed')
    return checkpoint


def save(folder: Path, checkpoint: Checkpoint) -> None:
    """The old file becomes the generation before, unless it is torn; at every moment one of the two is whole."""
    newest = folder / CHECKPOINT
    if whole := _whole(newest):
        write_atomically(folder / CHECKPOINT_BEFORE, whole)
    write_atomically(newest, checkpoint.text())


def _whole(file: Path) -> str:
    """Text of a checkpoint that is fit to be kept; '' when the file is missing, torn or changed."""
    try:
        text = read_text(file)
        parse(text, file.name)
    except (OSError, ValueError):
        return ''
    return text


def load(folder: Path) -> tuple[Checkpoint | None, list[str]]:
    """The newest whole checkpoint (None: there is none) and what was wrong with newer ones."""
    doubts: list[str] = []
    for name in (CHECKPOINT, CHECKPOINT_BEFORE):
        try:
            return parse(read_text(folder / name), name), doubts
        except Missing:
            continue
        except (CheckpointError, FileError) as e:
            doubts.append(str(e))
    return None, doubts
