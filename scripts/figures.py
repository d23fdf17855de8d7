"""Puts the JSON lines of benchmarks into the tables of docs/figures.md: value, unit and date of each row.

python3 scripts/figures.py FILE.jsonl [--date '28 Nov']     (lines of `make bench`; what has no row is printed)
"""

from __future__ import annotations

import argparse
import datetime
import json
import re
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / 'docs' / 'figures.md'
COLUMNS = 5  # figure, value, unit, conditions, date


def updated(page: str, lines: list[dict], date: str) -> tuple[str, list[str]]:
    """The page with the values of `lines`, and the names that have no row in it."""
    values = {line['name']: line for line in lines}
    found, out = set(), []
    for row in page.splitlines():
        cells = [c.strip() for c in row.split('|')[1:-1]]
        name = re.fullmatch(r'`([\w.]+)`', cells[0]) if len(cells) == COLUMNS else None
        if name and (line := values.get(name[1])):
            found.add(name[1])
            cells[1], cells[2], cells[4] = f'{line["value"]:.4g}', line['unit'], date
            row = f'| {" | ".join(cells)} |'.replace('|  |', '| |')
        out.append(row)
    return '\n'.join(out) + '\n', [n for n in values if n not in found]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('file', type=Path)
    parser.add_argument('--date', default=f'{datetime.date.today():%-d %b}')
    args = parser.parse_args()
    lines = [json.loads(s) for s in args.file.read_text().splitlines() if s.startswith('{')]
    page, missing = updated(PAGE.read_text(), lines, args.date)
    PAGE.write_text(page)
    for name in missing:
        print(f'no row for {name}')


if __name__ == '__main__':
    main()
