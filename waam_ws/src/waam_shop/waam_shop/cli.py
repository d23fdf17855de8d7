"""`waam queue`, `waam cells`, `waam token`, `waam audit`, `waam notify`."""

from __future__ import annotations

import argparse

from . import cli_access, cli_cells, cli_notify, cli_queue
from .shop_folder import Places


def register(commands: argparse._SubParsersAction, places: Places) -> None:
    """Adds the verbs of a shop."""
    cli_cells.register(commands, places)
    cli_queue.register(commands, places)
    cli_access.register(commands, places)
    cli_notify.register(commands, places)
