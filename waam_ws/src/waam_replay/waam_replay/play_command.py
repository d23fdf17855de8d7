"""`waam replay play`: the player as a process of its own."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys

from waam_record.read_record import record_folder

END_S = 10.0  # after which a player that was interrupted is killed


def parameters(values: dict[str, object]) -> list[str]:
    """`-p name:=value` for everything that is set."""
    made: list[str] = []
    for name, value in values.items():
        if value in ('', None):
            continue
        text = json.dumps(value) if isinstance(value, bool | float | int) else f"'{value}'"
        made += ['-p', f'{name}:={text}']
    return made


def play(args: argparse.Namespace) -> int:
    """Runs until the record is over or Ctrl-C; exit status of the player."""
    values: dict[str, object] = {
        'record': str(record_folder(args.job).resolve()), 'rate': float(args.rate), 'topics': ' '.join(args.topics),
        'exclude': args.exclude, 'remap': ' '.join(args.remap), 'start': float(args.start),
        'until': float(args.until), 'paused': args.paused, 'force': args.force,
    }  # fmt: skip
    command = [sys.executable, '-c', 'from waam_replay.player_node import main; main()']
    env = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', **os.environ}
    player = subprocess.Popen([*command, '--ros-args', *parameters(values)], env=env)
    try:
        return player.wait()
    except KeyboardInterrupt:
        player.send_signal(signal.SIGINT)
        try:
            player.wait(END_S)
        except subprocess.TimeoutExpired:
            player.kill()
            player.wait()
        return 130
