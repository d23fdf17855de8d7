"""Recorded jobs (MCAP) as scans: profile batches and telemetry, one `Pass` for every time the scanner was on."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from waam_node.cdr import read_pose
from waam_process.safe_files import parse_json
from waam_record.bag_reader import info
from waam_record.decode import LAYOUTS, DecodeError, check_layout
from waam_record.salvage import messages

from .calibration.scan_pass import Pass
from .left_out import LeftOut, leave_out
from .map_file import FileError
from .stream.profiles import ProfileBlock, read_batch
from .transform import Mounting

PAUSE = 1.0  # s without profiles: the scanner was off, a new scan begins
MARGIN_NS = 1_000_000_000  # telemetry that is kept before and after a scan
SHOWN = 3  # kinds of damage that are named


def record_files(path: Path) -> list[Path]:
    """The .mcap files of a job folder (`record`, `record_2` ... of a resumed one), of a record folder, or the file
    itself; empty when there are none."""
    path = Path(path)
    if path.suffix == '.mcap' and path.is_file():
        return [path]
    found = [*path.glob('record*/*.mcap')] or [*path.glob('*.mcap')]
    return sorted(found, key=lambda f: (len(str(f)), str(f)))


def _files_of(path: Path) -> list[Path]:
    """`record_files`; FileError when there are none, with the way for logs of other programs."""
    if found := record_files(path):
        return found
    raise FileError(
        f'{path}: no .mcap file there; logs of other programs become one by `waam record import FILE ... -o NAME.mcap`'
    )


def recorded_mounting(path: Path) -> Mounting:
    """Where the scanner sat in that job: the parameters of scan_fusion that were recorded, else the defaults.

    FileError when the job used a calibration file, which is not in the recording.
    """
    text = info(_files_of(path)[0]).custom_data.get('parameters.scan_fusion')
    if text is None:
        return Mounting()
    p = parse_json(text, f'{path}: parameters.scan_fusion', finite=False)
    if p.get('calibration'):
        raise FileError(
            f'{path}: the job used the calibration {p["calibration"]}: name it with --calibration'
        )
    return Mounting.from_rpy(
        tuple(p['mount_xyz']), tuple(p['mount_rpy']), float(p['profile_delay'])
    )


@dataclass
class _Scan:
    """What was read so far of a scan."""

    name: str
    number: int = 0
    blocks: list[ProfileBlock] = field(default_factory=list)
    poses: deque = field(default_factory=deque)  # ns, x, y, z
    newest_ns: int = 0
    damage: list[str] = field(default_factory=list)  # what is missing in the files

    def starts_anew(self, block: ProfileBlock, pause_ns: int) -> bool:
        return bool(self.blocks) and int(block.stamps.min()) > self.newest_ns + pause_ns

    def add(self, block: ProfileBlock) -> None:
        last = int(block.stamps.max())
        self.newest_ns = max(self.newest_ns, last) if self.blocks else last
        self.blocks.append(block)

    def tell(self, pose: tuple[int, float, float, float]) -> None:
        self.poses.append(pose)
        while not self.blocks and pose[0] > self.poses[0][0] + 2 * MARGIN_NS:
            self.poses.popleft()

    def finish(self) -> Pass:
        """The pass, by stamps; ScanError when telemetry is missing altogether."""
        width = max(b.x.shape[1] for b in self.blocks)
        stamps = np.concatenate([b.stamps for b in self.blocks])
        x, z = (
            np.concatenate([_padded(getattr(b, name), width) for b in self.blocks])
            for name in ('x', 'z')
        )
        t = np.array([p[0] for p in self.poses], np.int64)
        t, first = np.unique(t, return_index=True)
        near = (t >= stamps.min() - MARGIN_NS) & (t <= stamps.max() + MARGIN_NS)
        xyz = np.array([p[1:] for p in self.poses]).reshape(-1, 3)[first]
        if near.sum() < 2:
            raise FileError(f'{self.name}, scan {self.number}: no telemetry around its profiles')
        order = np.argsort(stamps, kind='stable')
        self.blocks, self.number = [], self.number + 1
        name = f'{self.name}, scan {self.number - 1}'
        return Pass(stamps[order], x[order], z[order], t[near], xyz[near], name)


def _padded(values: np.ndarray, width: int) -> np.ndarray:
    out = np.full((len(values), width), np.nan, np.float32)
    out[:, : values.shape[1]] = values
    return out


def passes(path: Path, pause: float = PAUSE, left_out: LeftOut | None = None) -> Iterator[Pass]:
    """The scans of a recording, one after the other as they are read; profiles more than `pause` s apart belong to
    different ones. What a damaged file still holds is used. FileError when there is no scan in it, and for one without
    telemetry; with left_out that one goes there, as does what is damaged."""
    files = _files_of(path)
    scan = _Scan(str(path))
    for file in files:
        for kind, data in _messages(file, scan.damage):
            if kind.endswith('Telemetry'):
                scan.tell(read_pose(data))
                continue
            block = _readable(data, scan.damage)
            if block is None:
                continue
            if scan.starts_anew(block, round(pause * 1e9)):
                yield from _finished(scan, left_out)
            scan.add(block)
    if scan.blocks:
        yield from _finished(scan, left_out)
    if left_out is not None and scan.number:
        for text in scan.damage:
            left_out.add('block', path, '', text)
    if not scan.number:
        raise FileError(f'{path}: no profile in it ({found_in(scan.damage)})')


def _finished(scan: _Scan, left_out: LeftOut | None) -> Iterator[Pass]:
    try:
        yield scan.finish()
    except FileError as e:
        leave_out(left_out, 'scan', f'{scan.name}, scan {scan.number}', '', e)
        scan.blocks, scan.number = [], scan.number + 1


def found_in(damage: list[str]) -> str:
    """What is wrong with a recording, in a line of bounded length."""
    more = f' and {len(damage) - SHOWN} more' if len(damage) > SHOWN else ''
    return '; '.join(damage[:SHOWN]) + more or 'its scanner was never on'


def _readable(data: bytes, damage: list[str]) -> ProfileBlock | None:
    try:
        return read_batch(data)[1]
    except ValueError as e:
        damage.append(str(e))
        return None


def _messages(file: Path, damage: list[str]) -> Iterator[tuple[str, bytes]]:
    """Type and bytes of the profile batches and telemetry of a file, in its order."""
    checked: set[int] = set()
    for channel, schema, message in messages(file, damage):
        if schema.name not in LAYOUTS:
            continue
        if channel.id not in checked:
            checked.add(channel.id)
            try:
                check_layout(schema.name, schema.data)
            except DecodeError as e:
                raise FileError(f'{file}: {e}') from None
        yield schema.name, message.data
