"""Results on disk: one folder, one YAML file and one report per calibration, the raw samples beside them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from waam_process.safe_files import FileError, read_npz, read_yaml

from .evidence import EvidenceError
from .resonance import Samples
from .results import GONE, Result, ResultError, from_data, to_data
from .sweep import Sweep

HEAD = '# Made by `waam calibrate`; the hash tells whether it was changed. `waam calibrate status` lists what counts.\n'


@dataclass(frozen=True)
class Stored:
    """What lies in a folder; damaged: files that cannot be used, and why."""

    results: list[Result]
    damaged: list[str]


def path_of(folder: Path, result: Result) -> Path:
    """Its YAML file; the report has the same name."""
    return folder / f'{result.name}_{result.when:%Y%m%dT%H%M%SZ}.yaml'


def save(folder: Path, result: Result, report: str) -> Path:
    """Writes result and report; returns the path of the result."""
    folder.mkdir(parents=True, exist_ok=True)
    path = path_of(folder, result)
    path.with_suffix('.html').write_text(report)
    text = yaml.safe_dump(to_data(result), sort_keys=False, allow_unicode=True)
    path.write_text(HEAD + text)
    return path


def load(path: Path) -> Result:
    """ResultError names the file and what is wrong with it."""
    try:
        return from_data(read_yaml(path))
    except ResultError as e:
        raise ResultError(f'{path}: {e}') from None
    except FileError as e:
        raise ResultError(str(e)) from None
    except (ValueError, TypeError, AttributeError) as e:
        raise ResultError(f'{path}: cannot be read: {e}') from None


def load_all(folder: Path) -> Stored:
    """All results of a folder; none when there is no folder."""
    found = Stored([], [])
    for path in sorted(folder.glob('*.yaml')):
        if path.name.partition('_')[0] in GONE:
            continue
        try:
            found.results.append(load(path))
        except ResultError as e:
            found.damaged.append(str(e))
    return found


def save_samples(path: Path, samples: Samples, sweep: Sweep) -> None:
    """As .npz: values (n, 3) and rest (m, 3) m/s^2, rate, range, lost, and the sweep (SI)."""
    np.savez_compressed(
        path,
        values=samples.values.astype(np.float32),
        rest=samples.rest.astype(np.float32),
        rate=samples.rate,
        range=samples.range,
        lost=samples.lost,
        sweep=np.array(dataclasses.astuple(sweep)),
    )


def load_samples(path: Path) -> tuple[Samples, Sweep]:
    """Samples and the sweep that they were taken in. EvidenceError when the file does not hold them."""
    try:
        data = read_npz(path)
        values, rest = (np.asarray(data[n], float) for n in ('values', 'rest'))
        rate, limit = float(data['rate']), float(data['range'])
        samples = Samples(values, rest, rate, limit, int(data['lost']))
        return samples, Sweep(*map(float, data['sweep']))
    except (KeyError, ValueError, TypeError) as e:
        raise EvidenceError(f'{path} holds no samples of a sweep: {e}') from None
