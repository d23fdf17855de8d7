"""Options of the command line that have a new name: the old one works, is not shown, and says so."""

from __future__ import annotations

import argparse
import sys
from typing import Any


class _Renamed(argparse.Action):
    """Stores as the option of the new name does. const: that name."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        print(f'{option_string} is now called {self.const}', file=sys.stderr)
        setattr(namespace, self.dest, values)


def keep_old_name(parser: argparse._ActionsContainer, old: str, option: argparse.Action) -> None:
    """Lets `parser` take `option` by its old name, too: with the same values and the same effect."""
    parser.add_argument(
        old,
        action=_Renamed,
        const=option.option_strings[0],
        dest=option.dest,
        nargs=option.nargs,
        choices=option.choices,
        default=argparse.SUPPRESS,
        help=argparse.SUPPRESS,
    )
