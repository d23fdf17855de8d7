"""How the command line speaks: verbs in groups, an error with the usage of the verb that was meant and the nearest
name, completion for shells. No ROS."""

from __future__ import annotations

import argparse
import difflib
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NoReturn

from waam_process.cli_options import Verbs, add_verb

GROUPS: dict[str, tuple[str, ...]] = {
    'a running cell': ('up', 'stop', 'status', 'panel', 'demo'),
    'jobs': ('job', 'jobs', 'report', 'view'),
    'plan and predict, without a machine': ('plan', 'forecast', 'lab', 'lab fit', 'scan', 'correct', 'robot', 'train'),
    'set up and calibrate': ('cell', 'ports', 'calibrate', 'commission', 'completion'),
    'recordings': ('record', 'replay'),
    'many cells': ('cells', 'queue', 'token', 'audit', 'notify'),
}  # fmt: skip
SHELLS = ('bash', 'zsh', 'fish')
COMPLETION = """\
Prints what completes verbs and options of waam in a shell:
  bash   waam completion bash > ~/.local/share/bash-completion/completions/waam
  zsh    waam completion zsh > DIRECTORY_OF_FPATH/_waam
  fish   waam completion fish > ~/.config/fish/completions/waam.fish"""


class Parser(argparse.ArgumentParser):
    """An error shows the usage of the verb that was called and, for what is misspelt, the nearest known name."""

    def parse_known_args(self, args=None, namespace=None):  # type: ignore[no-untyped-def]
        """Each verb refuses what it does not know; argparse would leave that to the first parser."""
        found, rest = super().parse_known_args(args, namespace)
        if rest:
            options = [o for a in self._actions for o in a.option_strings]
            near = nearest(rest[0].split('=')[0], options) if rest[0].startswith('-') else ''
            self.error(f'unrecognized arguments: {" ".join(rest)}{near}')
        return found, rest

    def error(self, message: str) -> NoReturn:
        """Exit status 2."""
        if wrong := re.match(r"argument .*: invalid choice: '(.*)' \(choose from (.*)\)$", message):
            known = re.findall(r"'([^']*)'", wrong[2])
            hint = nearest(wrong[1], known) or f'; known are {", ".join(known)}'
            message = f'{message.split(": invalid")[0]}: {wrong[1]!r} is none{hint}'
        self.print_usage(sys.stderr)
        self.exit(2, f'{self.prog}: error: {message}\n(all of it: {self.prog} --help)\n')


def nearest(word: str, known: Iterable[str]) -> str:
    """'; did you mean ...?', or nothing where no name is near."""
    near = difflib.get_close_matches(word, list(known), 1)
    return f"; did you mean '{near[0]}'?" if near else ''


class Grouped(argparse.RawDescriptionHelpFormatter):
    """Help of the first level: the verbs in groups."""

    def _format_action(self, action: argparse.Action) -> str:
        if not isinstance(action, argparse._SubParsersAction):
            return super()._format_action(action)
        verbs = {v.dest: v for v in action._get_subactions()}
        rest = tuple(name for name in verbs if name not in sum(GROUPS.values(), ()))
        parts = []
        for title, names in {**GROUPS, 'more': rest}.items():
            if shown := [verbs[name] for name in names if name in verbs]:
                parts += [
                    f'\n  {title}:\n',
                    *(super(Grouped, self)._format_action(v) for v in shown),
                ]
        return ''.join(parts)


def register_completion(commands: Verbs, parser: argparse.ArgumentParser) -> None:
    """Adds `waam completion`."""
    p = add_verb(
        commands, 'completion', 'completion of verbs and options for bash, zsh or fish',
        ('shell', None, 'of ' + ', '.join(SHELLS), None, {'choices': SHELLS, 'type': str}), description=COMPLETION,
    )  # fmt: skip
    p.set_defaults(run_command=lambda args: _complete(parser, args.shell))


def _complete(parser: argparse.ArgumentParser, shell: str) -> int:
    import shtab

    for one in _parsers(parser):
        for action in one._actions:
            if action.type is Path:
                setattr(action, 'complete', shtab.FILE)  # noqa: B010  what shtab looks for
    print(shtab.complete(parser, shell))
    return 0


def _parsers(parser: argparse.ArgumentParser) -> Iterable[Any]:
    """This one and those of all verbs below it."""
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from _parsers(below)
