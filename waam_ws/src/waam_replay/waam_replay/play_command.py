"""`waam replay play`: the player as a process of its own; in lock-step also the nodes that are asked, with the
parameters that they were recorded with, in a ROS domain where nothing else runs."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import IO

import yaml

from waam_process.safe_files import parse_json
from waam_record.bag_reader import info
from waam_record.read_record import ReplayError, record_folder

from .transport import quick_environment

ASKED = {
    'scan_fusion': 'waam_scan.scan_fusion_node',
    'correction_server': 'waam_adapt.correction_server_node',
    'feed_forward': 'waam_adapt.feed_forward_node',
}
DOMAINS = 99  # 1 .. 99: their ports lie below those that the system hands out
END_S = 10.0
LOOK_S = 0.1


def start(
    module: str,
    domain: int | None,
    arguments: list[str],
    changes: dict[str, str] | None = None,
    log: IO[bytes] | None = None,
) -> subprocess.Popen:
    """The `main` of a node module as a process, with `changes` of its environment; log: instead of our output."""
    command = [sys.executable, '-c', f'from {module} import main; main()', '--ros-args', *arguments]
    env = {**os.environ, **(changes or {})}
    if domain is not None:
        env['ROS_DOMAIN_ID'] = str(domain)
    env.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    return subprocess.Popen(command, env=env, stdout=log, stderr=log)


def end(processes: list[subprocess.Popen]) -> None:
    """Interrupts the processes and waits; kills those that have not ended after END_S each."""
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    for process in processes:
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def nodes(folder: Path, domain: int) -> Iterator[Callable[[], str]]:
    """The nodes that a job calls, with the recorded parameters. Yields a function that names a node that has ended,
    with its last output; '' while all run."""
    custom = info(folder).custom_data
    with tempfile.TemporaryDirectory(prefix='waam_replay_') as name:
        scratch = Path(name)
        running: dict[str, subprocess.Popen] = {}

        def trouble() -> str:
            ended = (n for n, p in running.items() if p.poll() is not None)
            return next((f'{n} ended: {_last_words(scratch / f"{n}.log")}' for n in ended), '')

        try:
            for node, module in ASKED.items():
                name = f'parameters.{node}'
                values = parse_json(custom.get(name, '{}'), name, finite=False)
                values['use_sim_time'] = True
                file = scratch / f'{node}.yaml'
                file.write_text(yaml.safe_dump({node: {'ros__parameters': values}}))
                with open(scratch / f'{node}.log', 'wb') as log:
                    running[node] = start(module, domain, ['--params-file', str(file)], log=log)
            yield trouble
        finally:
            end(list(running.values()))


def _last_words(log: Path) -> str:
    lines = log.read_text(errors='replace').strip().splitlines()
    return lines[-1] if lines else 'without a word'


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
    """Runs until the record is over or Ctrl-C. Exit status 1 when lock-step found a difference."""
    folder = record_folder(args.job)
    values: dict[str, object] = {'record': str(folder.resolve()), 'lockstep': args.lockstep}
    if not args.lockstep:
        values |= {
            'rate': float(args.rate), 'topics': ' '.join(args.topics), 'exclude': args.exclude,
            'remap': ' '.join(args.remap), 'start': float(args.start), 'until': float(args.until),
            'paused': args.paused, 'force': args.force,
        }  # fmt: skip
        return _wait(start('waam_replay.player_node', None, parameters(values)), _no_trouble)
    with tempfile.TemporaryDirectory(prefix='waam_replay_') as scratch:
        report = Path(scratch) / 'report.json'
        values['report'] = str(report)
        quick = quick_environment(dict(os.environ), Path(scratch))
        domain = args.domain
        if domain is None and not args.attach:
            domain = 1 + os.getpid() % DOMAINS
        asked = nullcontext(_no_trouble) if args.attach else nodes(folder, domain)
        with asked as trouble:
            _wait(start('waam_replay.player_node', domain, parameters(values), quick), trouble)
        return _judge(report)


def _no_trouble() -> str:
    return ''


def _wait(process: subprocess.Popen, trouble: Callable[[], str]) -> int:
    """Exit status of the player; it is ended when there is `trouble`, or by Ctrl-C."""
    try:
        while process.poll() is None:
            if text := trouble():
                end([process])
                raise ReplayError(text)
            time.sleep(LOOK_S)
        return process.returncode
    except KeyboardInterrupt:
        end([process])
        return 130


def _judge(report: Path) -> int:
    if not report.exists():
        print('error: the player ended before its work was done', file=sys.stderr)
        return 1
    found = json.loads(report.read_text())
    for kind, total in found['total'].items():
        print(f'{kind}: {found["identical"][kind]} of {total} identical')
    for text in found['differences']:
        print(f'different: {text}')
    if found['error']:
        print(f'error: {found["error"]}', file=sys.stderr)
    print(f'{found["seconds"]:.1f} s')
    return 0 if found['same'] else 1
