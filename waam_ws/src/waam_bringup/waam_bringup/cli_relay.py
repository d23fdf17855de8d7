"""`waam relay`: its options."""

from __future__ import annotations

import argparse

from .cli_common import add_run, run_and_domain


def register(commands: argparse._SubParsersAction) -> None:
    """Adds the verb."""
    text = (
        "publishes what a cell tells on another ROS domain, under the cell's name (/cell2/telemetry ...), for screens "
        'and loggers of a site; one-way: nothing there can command the cell'
    )
    p = commands.add_parser(
        'relay', help='shows the topics of a cell to a whole site', description=text
    )
    add_run(p, '--name')
    p.add_argument(
        '--to-domain',
        type=int,
        required=True,
        metavar='N',
        help='ROS_DOMAIN_ID of the site, 0 to 101',
    )
    p.add_argument(
        '--reach',
        choices=('LOCALHOST', 'SUBNET'),
        default='SUBNET',
        help='LOCALHOST: readers on this computer only; SUBNET: on the network, too (default)',
    )
    p.set_defaults(run_command=_relay)


def _relay(args: argparse.Namespace) -> int:
    """Until Ctrl-C. ValueError; ClientError when no graph is up."""
    from .operate import require_up
    from .paths import cell_name

    site = args.to_domain
    if not 0 <= site <= 101:
        raise ValueError(f'--to-domain {site}, must be 0 to 101')
    folder, domain = run_and_domain(args)
    if domain == site:
        raise ValueError(
            f'--to-domain {site} is that of the cell itself; cells of one site must not hear one another'
        )
    require_up(folder)
    from .node_relay import TOPICS, relay

    names = ', '.join(f'/{cell_name()}/{t.lstrip("/")}' for t in TOPICS)
    said = f'ROS_DOMAIN_ID={site} ({args.reach}): {names}; Ctrl-C ends it'
    relay(cell_name(), domain, site, args.reach, lambda: print(said, flush=True))
    return 0
