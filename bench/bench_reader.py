"""Files of others.

reader.cases: share of the cases of `waam_plan/test/reader_cases.py` that are read as they are, or refused by their true
cause; the same cases are tests (`test_reader_cases.py`). Baseline: the share of the readers before them (commit
986bae11, measured by the same list: `git archive 986bae11 waam_ws/src`, its packages on PYTHONPATH). That share counts
notes that did not exist then as missing; by formats on stderr.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

from lib.emit import emit

TESTS = Path(__file__).resolve().parents[1] / 'waam_ws/src/waam_plan/test'
BEFORE = 84 / 257


def cases() -> None:
    """Each case that fails by name on stderr."""
    sys.path.insert(0, str(TESTS))
    from reader_case import fault
    from reader_cases import CASES

    held, right = Counter(), Counter()
    for case in CASES:
        kind = Path(case.name).suffix
        held[kind] += 1
        with tempfile.TemporaryDirectory(prefix='waam_bench_') as scratch:
            wrong = fault(case, Path(scratch))
        right[kind] += not wrong
        if wrong:
            print(f'reader.cases: {case.name}, {case.about}: {wrong}', file=sys.stderr)
    for kind, count in held.items():
        print(f'reader.cases: {kind}: {right[kind]} of {count}', file=sys.stderr)
    share = right.total() / held.total()
    emit('reader.cases', share, 'share', f'before, same {held.total()} cases', BEFORE)


FIGURES = {'reader.cases': cases}
