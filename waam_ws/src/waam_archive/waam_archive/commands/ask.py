"""Verbs that ask many jobs together: trend, figures, trace, sql."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waam_process.prices import Prices
from waam_process.safe_files import read_yaml

from ..figures import GROUPS, grouped, key_figures
from ..metrics import METRICS
from .common import Row, Verbs, add_filters, add_verb, opened, print_json, print_table, selection

if TYPE_CHECKING:
    from ..charts import Chart


MIN_LIMIT_POINTS = 20  # points that limits should come from (usual advice: 20 to 25 subgroups)


def register(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    """Adds the verbs."""
    _register_trend(verbs, common)
    text = 'key figures: kg/h, wire and energy per area restored, defects, use of material, cost'
    p = add_verb(verbs, common, 'figures', text, _figures)
    p.add_argument('--by', choices=sorted(GROUPS), help='one column per value')
    p.add_argument('--prices', type=Path, metavar='FILE', help='YAML with prices (docs/archive.md)')
    add_filters(p)
    text = 'traceability record of one part over all its jobs (ISO/ASTM 52943-2)'
    p = add_verb(verbs, common, 'trace', text, _trace)
    p.add_argument(
        'part',
        metavar='PART',
        help='file name of the part, as `waam jobs list` prints it, or a piece of it that no other part has',
    )
    p.add_argument('-o', '--output', type=Path, metavar='FILE', help='write an HTML page')
    text = 'one SELECT over the tables of waam_archive/doc/tables.md; nothing can be written or read outside'
    p = add_verb(verbs, common, 'sql', text, _sql)
    p.add_argument('query', metavar='SELECT')


def _register_trend(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    text = 'control chart of a figure over the jobs, with the rules that name a drift, and Cpk'
    p = add_verb(verbs, common, 'trend', text, _trend)
    listed = '; '.join(f'{k}: {m.text}' for k, m in METRICS.items())
    p.add_argument('metric', choices=sorted(METRICS), metavar='FIGURE', help=listed)
    p.add_argument(
        '--subgroup',
        type=int,
        default=1,
        metavar='N',
        help='jobs per subgroup (X-bar-R), 1 = single values',
    )
    p.add_argument(
        '--baseline',
        type=int,
        default=0,
        metavar='K',
        help='limits from the first K subgroups; 0 = all',
    )
    p.add_argument(
        '--lower', type=float, default=-math.inf, help='limit of the specification, for Cpk'
    )
    p.add_argument(
        '--upper', type=float, default=math.inf, help='limit of the specification, for Cpk'
    )
    p.add_argument('--picture', type=Path, metavar='FILE', help='draw the chart (png, svg, pdf)')
    add_filters(p)


def _trend(args: argparse.Namespace) -> int:
    from ..charts import chart
    from ..trend import values_of

    jobs, created, values = values_of(opened(args), args.metric, selection(args))
    rows = [
        {'job': str(job), 'created': when, 'value': float(v)}
        for job, when, v in zip(jobs, created.astype(object), values, strict=True)
    ]
    spec = (args.lower, args.upper)
    found = chart(values, args.subgroup, args.baseline, spec)
    ends = [
        rows[i] for i in range(args.subgroup - 1, len(found.means) * args.subgroup, args.subgroup)
    ]
    if args.picture:
        from ..picture import draw

        labels = [f'{r["created"]:%Y-%m-%d}' if r['created'] else '?' for r in ends]
        draw(found, METRICS[args.metric], labels, args.picture)
    if args.json:
        print_json({'metric': args.metric, 'jobs': rows, **asdict(found)})
    else:
        _print_chart(args, found, ends)
    return 0


def _print_chart(args: argparse.Namespace, found: Chart, ends: list[Row]) -> None:
    metric = METRICS[args.metric]
    kind = 'mean of subgroups' if found.group > 1 else 'value'
    print(
        f'{metric.text}{", " + metric.unit if metric.unit else ""}: {len(found.means)} points, {kind}'
    )
    print_table(
        ['', 'lower limit', 'center', 'upper limit', 'last'],
        [
            [kind, found.lower, found.center, found.upper, found.means[-1]],
            ['range', found.range_lower, found.range_center, found.range_upper, found.ranges[-1]],
        ],
    )
    if math.isfinite(found.cpk):
        print(f'Cpk {found.cpk:.2f}')
    if found.left_over:
        print(f'{found.left_over} newest jobs make no whole subgroup yet and are not on the chart')
    for s in found.signals:
        print(f'{s.rule}: {s.text}; last at {ends[s.points[-1]]["job"]}, {len(s.points)} times')
    if not found.signals:
        print('no rule is broken')
    if len(found.means) < MIN_LIMIT_POINTS:
        print(
            f'{len(found.means)} points are few: limits from less than {MIN_LIMIT_POINTS} are rough'
        )
    if args.picture:
        print(f'picture: {args.picture}')


def _figures(args: argparse.Namespace) -> int:
    prices = read_prices(args.prices) if args.prices else None
    jobs = opened(args).jobs(selection(args))
    found = grouped(jobs, args.by, prices) if args.by else {'all': key_figures(jobs, prices)}
    if args.json:
        print_json(found)
        return 0
    names = list(dict.fromkeys(name for row in found.values() for name in row))
    print_table(['', *found], [[n, *(row.get(n) for row in found.values())] for n in names])
    return 0


def read_prices(file: Path) -> Prices:
    """ValueError names the file and the entry."""
    import yaml

    try:
        return Prices.parse(read_yaml(file))
    except (ValueError, yaml.YAMLError) as e:
        raise ValueError(f'{file}: {" ".join(str(e).split())}') from None


def _trace(args: argparse.Namespace) -> int:
    from ..page import part_page
    from ..traceability import part_record

    archive = opened(args)
    part = archive.part_named(args.part)
    jobs = archive.rows(('jobs',), 'SELECT * FROM jobs WHERE part = ?', [part])

    def of_part(table: str) -> list[Row]:
        text = f'SELECT t.* FROM "{table}" t JOIN jobs USING (job) WHERE part = ?'
        return archive.rows((table, 'jobs'), text, [part])

    record = part_record(
        part, jobs, of_part('reports'), of_part('anomalies'), of_part('calibration')
    )
    if args.output:
        args.output.write_text(part_page(record), encoding='utf-8')
    if args.json:
        print_json(record)
    else:
        _print_record(record, args.output)
    return 0


def _print_record(record: dict[str, Any], page: Path | None) -> None:
    columns = ['created', 'job', 'operator', 'wire lot', 'verdict', 'not told']
    rows = [
        [e['created'], e['job'], e['operator'], e['feedstock']['wire_lot'], e['results']['verdict'],
        ', '.join(e['not_told']) or None]
        for e in record['jobs']
    ]  # fmt: skip
    print_table(columns, rows)
    for remark in record['remarks']:
        print(remark)
    if page:
        print(f'page: {page}')


def _sql(args: argparse.Namespace) -> int:
    columns, rows = opened(args).sql(args.query)
    if args.json:
        print_json([dict(zip(columns, r, strict=True)) for r in rows])
    else:
        print_table(columns, [list(r) for r in rows])
    return 0
