"""The correction server beside a running job.

adapt.service_p99_ms: round trip of the real service, 256 x 256 cells, new beads in every call, announced beforehand as
  a job does and as warm as the layer before, conversion included (baseline: what was asked). stderr also has calls that
  were not announced.
WAAM_BENCH_LAW (default: that of correction_server) the law, WAAM_BENCH_CALLS (default 300) service calls.
"""

from __future__ import annotations

import os
import sys

from lib.adapt_latency import measure
from lib.emit import emit

CALLS = int(os.environ.get('WAAM_BENCH_CALLS', '300'))


def service() -> None:
    """The law of a job, and the explicit one; the slower one counts."""
    from waam_adapt.laws.corrector import CorrectionParams

    law = os.environ.get('WAAM_BENCH_LAW', CorrectionParams().law)
    rows = {name: measure(name, CALLS) for name in dict.fromkeys(('damped_inverse', law))}
    alone = {f'{law}, not announced': measure(law, CALLS // 3, announced=False)}
    for name, row in (rows | alone).items():
        said = ', '.join(f'{k} {v:.1f}' for k, v in row.items())
        print(f'adapt: {name}: {said} (load {os.getloadavg()[0]:.1f})', file=sys.stderr)
    name, slowest = max(rows.items(), key=lambda row: row[1]['p99'])
    note = f'limit that was asked; {name}; server {slowest["memory_mb"]:.0f} MB'
    emit('adapt.service_p99_ms', slowest['p99'], 'ms', note, 60.0)


FIGURES = {'adapt.service_p99_ms': service}
