"""make bench [ONLY=name]: runs every benchmark in this folder (or the one that prints that name) and prints JSON lines.

A benchmark is a module bench_*.py with NAMES (what it prints) and main(), which calls `emit` for each figure.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

HERE = Path(__file__).parent


def main(only: str = '') -> int:
    """0, or 2 when no benchmark has that name."""
    sys.path.insert(0, str(HERE))
    known: list[str] = []
    ran = 0
    for file in sorted(HERE.glob('bench_*.py')):
        spec = importlib.util.spec_from_file_location(file.stem, file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        known += module.NAMES
        if not only or any(only in (name, name.split('.')[0]) for name in module.NAMES):
            module.main()
            ran += 1
    if not ran:
        print(f"no benchmark is called '{only}'; known are {', '.join(known)}", file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:2]))
