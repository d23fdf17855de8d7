"""`waam view` and `waam report`: look at a job."""

from __future__ import annotations

import argparse
import sys

_VIEW_EXAMPLES = """examples:
  waam view jobs/latest                     serves the job in the browser, prints the address; Ctrl-C ends
  waam view jobs/latest --png job.png       one picture of the end of the job, no screen needed
  waam view jobs/latest/record/record_0.mcap

A running graph is seen live: start the dashboard with web_port and open the address it reports in
/diagnostics, or run `rerun --connect rerun+http://127.0.0.1:9876/proxy`."""

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
    view.add_argument('--png', metavar='FILE', help='draw a picture instead of serving')
    view.add_argument('--port', type=int, default=9090, help='port of the web page (default 9090)')
    view.set_defaults(run=_view)
    report = commands.add_parser(
        'report', help='rebuild report.html of a job', epilog=_REPORT_EXAMPLES, formatter_class=raw
    )
    report.add_argument('path', metavar='JOB', help='folder with report.json')
    report.set_defaults(run=_report)


def _view(args: argparse.Namespace) -> int:
    from pathlib import Path

    from .viewer import ViewError, find_recording, screenshot, serve

    try:
        file = find_recording(Path(args.path))
        if args.png:
            screenshot(file, Path(args.png))
            print(args.png)
            return 0
        return serve(file, args.port)
    except ViewError as e:
        print(f'error: {e}', file=sys.stderr)
        return 1


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
