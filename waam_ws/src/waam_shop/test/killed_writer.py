"""A process that changes a queue and writes the audit log until it is killed; every finished step is told by a line."""

from __future__ import annotations

import sys
from pathlib import Path

from waam_shop.audit_file import AuditLog
from waam_shop.queue_file import QueueFile


def main(folder: Path) -> None:
    queue, log = QueueFile(folder), AuditLog(folder, 'cell')
    while True:
        made = queue.change(lambda q: q.add({'part': f'{q.last + 1}.stl'}, 'tester', 1.0))
        print(f'queue {made.last}', flush=True)
        entry = log.write('queue add', 'tester', 'cli', data={'id': made.last})
        print(f'audit {entry.n} {entry.hash}', flush=True)


if __name__ == '__main__':
    main(Path(sys.argv[1]))
