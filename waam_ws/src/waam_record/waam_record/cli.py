"""`waam record`: look at recordings, verify, save and import them; start and stop the recorder."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

from . import file_commands
from .file_commands import error as _error

_EXAMPLES = """examples:
  waam record info jobs/latest                what is in it: topics, messages, losses, duration
  waam record check jobs/latest               reads every byte again and compares checksums and counts
  waam record recover jobs/latest             saves what is whole in a recording that was cut off
  waam record import weld.csv > mapping.yaml  what the columns of somebody else's log may be, to check
  waam record import weld.csv --mapping mapping.yaml -o weld.mcap
  waam record start /tmp/record --note wire=ER70S-6                    the recorder of the graph
  waam record status                          messages, losses per topic, now

A recording is a folder with MCAP files and metadata.yaml: `ros2 bag play FOLDER`, rosbags, Foxglove,
PlotJuggler and rerun open it; `rosbags-convert` makes a recording of some of its topics."""


@dataclass(frozen=True)
class Graph:
    """How the command line names a graph. add_options: adds the options that do; domain: ROS_DOMAIN_ID of what they
    name, None = that of the environment."""

    add_options: Callable[[argparse.ArgumentParser], None] = lambda p: None
    domain: Callable[[argparse.Namespace], int | None] = lambda args: None


def register(commands: argparse._SubParsersAction, graph: Graph = Graph()) -> None:
    """Adds the verb `record` with its sub-verbs."""
    parser = commands.add_parser(
        'record',
        help='recordings: look, verify, save, import; steer the recorder',
        description=__doc__,
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = parser.add_subparsers(dest='record_verb', required=True, metavar='VERB')
    file_commands.register(verbs)
    _register_control(verbs, graph)


def _register_control(verbs: argparse._SubParsersAction, graph: Graph) -> None:
    start = verbs.add_parser('start', help='let the running recorder record into a new folder')
    start.add_argument('directory', metavar='FOLDER', help='must not exist yet')
    start.add_argument('--note', action='append', default=[], metavar='KEY=VALUE')
    graph.add_options(start)
    start.set_defaults(
        run_command=lambda args: _control(graph.domain(args), 'START', args.directory, args.note)
    )
    for name, text in (
        ('stop', 'close and verify the recording'),
        ('split', 'start the next file'),
        ('pause', 'leave out what comes now'),
        ('resume', 'go on after a pause'),
    ):
        verb = verbs.add_parser(name, help=text)
        graph.add_options(verb)
        verb.set_defaults(
            run_command=lambda args, code=name.upper(): _control(graph.domain(args), code)
        )
    text = 'what the recorder does: messages, losses per topic, what waits for the disk'
    status = verbs.add_parser('status', help=text, description=text)
    graph.add_options(status)
    status.set_defaults(run_command=lambda args: _status(graph.domain(args)))


def _status(domain: int | None) -> int:
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray

    found: list = []

    def take(msg: DiagnosticArray) -> None:
        found.extend(s for s in msg.status if s.hardware_id.startswith('recorder'))

    rclpy.init(domain_id=domain)
    try:
        node = rclpy.create_node('record_status')
        node.create_subscription(DiagnosticArray, '/diagnostics', take, 100)
        end = time.monotonic() + 6.0
        while not found and time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.1)
    finally:
        rclpy.try_shutdown()
    if not found:
        return _error('no recorder reports (is the graph up? `waam up`)')
    for status in found:
        print(f'{status.hardware_id}: {status.message}')
        for pair in status.values:
            print(f'  {pair.key} = {pair.value}')
    return 0


def _control(
    domain: int | None, code: str, directory: str = '', notes: list[str] | None = None
) -> int:
    from pathlib import Path

    import rclpy

    from waam_msgs.srv import Record

    folder = str(Path(directory).resolve()) if directory else ''
    request = Record.Request(
        code=getattr(Record.Request, code), directory=folder, custom_data=notes or []
    )
    rclpy.init(domain_id=domain)
    try:
        node = rclpy.create_node('record_cli')
        client = node.create_client(Record, 'recorder/control')
        if not client.wait_for_service(timeout_sec=3.0):
            return _error('no recorder answers (is the graph up? `waam up`)')
        time.sleep(0.2)  # a server that has not yet found a new client's reader loses the answer
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=30.0)
        if not future.done():
            if code == 'START':  # nobody would end what begins now
                undo = Record.Request(code=Record.Request.STOP, directory=folder)
                rclpy.spin_until_future_complete(node, client.call_async(undo), timeout_sec=1.0)
            return _error('the recorder did not answer within 30 s; a START is withdrawn')
        answer = future.result()
    finally:
        rclpy.try_shutdown()
    if not answer.success:
        return _error(answer.message)
    print(answer.message)
    return 0
