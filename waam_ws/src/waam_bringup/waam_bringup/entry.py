"""The installed command `waam`: what cannot wait first, then the command line, which takes a second to load."""

from __future__ import annotations

import sys

from .at_once import act


def main() -> int:
    """As `cli.main`."""
    act(sys.argv[1:])
    from .cli import main as command_line

    return command_line()
