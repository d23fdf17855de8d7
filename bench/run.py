"""make bench [ONLY=name]: measures the figures of this folder and prints them as JSON lines.

ONLY is the full name of a figure (loop.rms_ratio), of a group (loop: all names that begin with `loop.`), or
`help`, which lists all names. Without it every figure is measured. Figures that come out of one measurement are
printed together. Figures that were measured on simulated cells say their `preset`; `WAAM_BENCH_PRESET=recorded` takes
another one where it is not the figure itself that says which.

A benchmark is a module bench_*.py with
    FIGURES: name of each figure -> function that measures it and calls `emit`
    TABLES (optional): name -> function that prints a table; it runs only when its full name is asked for.
"""

from __future__ import annotations

import importlib.util
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

HERE = Path(__file__).resolve().parent
Measurement = Callable[[], None]


def _matches(name: str, asked: str) -> bool:
    return not asked or name == asked or name.startswith(asked + '.')


def load(folder: Path = HERE) -> tuple[dict[str, Measurement], dict[str, Measurement]]:
    """Figures and tables that the modules bench_*.py of a folder declare. ValueError for a name that is taken."""
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))  # for `lib`
    figures: dict[str, Measurement] = {}
    tables: dict[str, Measurement] = {}
    for file in sorted(folder.glob('bench_*.py')):
        spec = importlib.util.spec_from_file_location(file.stem, file)
        assert spec and spec.loader
        module = importlib.util.module_from_spec(spec)
        sys.modules[file.stem] = module
        spec.loader.exec_module(module)
        for known, new in ((figures, module.FIGURES), (tables, getattr(module, 'TABLES', {}))):
            for name in new:
                if name in figures or name in tables:
                    raise ValueError(f'{file.name}: two benchmarks are called {name}')
            known |= new
    return figures, tables


def measure(measurements: Iterable[Measurement]) -> int:
    """Runs them one after the other; one that fails does not stop those behind it. Returns how many failed."""
    failed = 0
    for run in measurements:
        began = time.monotonic()
        try:
            run()
            said = 'took'
        except Exception:
            traceback.print_exc()
            failed += 1
            said = 'failed after'
        took = time.monotonic() - began
        of = run.func if isinstance(run, partial) else run
        print(f'# {of.__module__}: {of.__name__} {said} {took:.0f} s', file=sys.stderr)
    return failed


def main(arguments: list[str], folder: Path = HERE) -> int:
    """0; 1 when a measurement failed, 2 when the command line asks for what is not there."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that what was started is ended
    if len(arguments) > 1:
        print('usage: python bench/run.py [NAME | --list]', file=sys.stderr)
        return 2
    asked = arguments[0] if arguments else ''
    figures, tables = load(folder)
    known = '\n'.join([*figures, *tables])
    if asked in ('help', '--list', '--help', '-h'):
        print(known)
        return 0
    some = [m for name, m in figures.items() if _matches(name, asked)]
    if asked in tables:
        some = [tables[asked]]
    if not some:
        print(f"no benchmark is called '{asked}'; known are\n{known}", file=sys.stderr)
        return 2
    return 1 if measure(dict.fromkeys(some)) else 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
