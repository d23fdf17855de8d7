"""What the verbs of a shop share."""

from __future__ import annotations

import argparse
import json
import os
from datetime import UTC, datetime
from typing import Any

from .cells import check_name
from .shop_folder import Places, Shop

NAME = (
    '--name --cell',
    str,
    'name of the cell (default: $WAAM_CELL, or cell)',
    'CELL',
    {'dest': 'cell'},
)
JSON = ('--json', False, 'JSON instead of a table, for scripts')


def shop_and_cell(args: argparse.Namespace, places: Places) -> tuple[Shop, str]:
    """The shop, and the name of the cell that is meant."""
    return Shop(places.shop()), check_name(args.cell or places.cell())


def user() -> str:
    """Who calls: the name of the account."""
    import getpass

    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())


def when(utc: float) -> str:
    """Local date and time to the second, '' for 0."""
    if not utc:
        return ''
    return datetime.fromtimestamp(utc, UTC).astimezone().strftime('%Y-%m-%d %H:%M:%S')


def show(data: Any) -> None:
    """Prints JSON."""
    print(json.dumps(data, indent=1))
