"""`waam view` and `waam report`: look at a job."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

_VIEW_EXAMPLES = """examples:
  waam view jobs/latest                     serves the job in the browser, prints the address; Ctrl-C ends
  waam view jobs/latest --record            from the record (MCAP), also when the dashboard kept a job.rrd
  waam view jobs/latest/record/record_0.mcap

A running graph is seen live: `waam up --web-port 9090` serves the dashboard, and the operator's page
(`waam panel`) embeds it."""

_REPORT_EXAMPLES = """examples:
  waam report jobs/latest         rebuilds report.html of a job
  waam report jobs/<demo folder>  the comparison, and the reports of its runs"""


def register(commands: argparse._SubParsersAction) -> None:
    """Adds the verbs `view` and `report`."""
    raw = argparse.RawDescriptionHelpFormatter
    view = commands.add_parser(
        'view', help='open a job in the rerun viewer', epilog=_VIEW_EXAMPLES, formatter_class=raw
    )
    view.add_argument('path', metavar='JOB|FILE', help='job folder, .rrd or .mcap')
    view.add_argument(
        '--record', action='store_true', help='from the MCAP even if there is a job.rrd'
    )
    view.add_argument('--port', type=int, default=9090, help='port of the web page (default 9090)')
    view.set_defaults(run_command=_view)
    report = commands.add_parser(
        'report', help='rebuild report.html of a job', epilog=_REPORT_EXAMPLES, formatter_class=raw
    )
    report.add_argument('path', metavar='JOB', help='folder with report.json')
    report.set_defaults(run_command=_report)


def _view(args: argparse.Namespace) -> int:
    import tempfile
    from pathlib import Path

    from .viewer import ViewError, serve

    try:
        with tempfile.TemporaryDirectory(prefix='waam_view_') as scratch:
            target = Path(scratch) / 'view' / 'job.rrd'
            return serve(_recording(Path(args.path), target, args.record), args.port)
    except (ViewError, OSError) as e:
        print(f'error: {e}', file=sys.stderr)
        return 1


def _recording(path: Path, scratch: Path, from_record: bool) -> Path:
    """The file to open: what the dashboard kept, else made from the records."""
    from .viewer import find_recording

    file = find_recording(path)
    if file.suffix == '.rrd' and not from_record:
        return file
    from rich.progress import Progress

    from .ros_playback import build, size

    scratch.parent.mkdir()
    with Progress(transient=True) as bar:
        task = bar.add_task('reading the record', total=size(path))
        build(path, scratch, lambda count: bar.advance(task, count))
    return scratch


def _report(args: argparse.Namespace) -> int:
    from pathlib import Path

    from .job_data import JobError
    from .report import write_all

    try:
        for written in write_all(Path(args.path)):
            print(written)
    except (JobError, OSError) as e:
        print(f'error: {e}', file=sys.stderr)
        return 1
    return 0
