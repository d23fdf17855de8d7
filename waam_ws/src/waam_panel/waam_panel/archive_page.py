"""All jobs together, for the page: what the archive (waam_archive) says of them. No ROS.

The library that answers takes half a second to load, so it is loaded with the first question.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from waam_archive.archive import Archive
    from waam_archive.selection import Selection

FILTERS = ('part', 'material', 'wire_lot', 'operator', 'verdict', 'loop_mode')
SHOWN = 60  # rows of the table
POINTS = 300  # newest points of the chart
MAX_FILTER_LENGTH = 80  # letters of a filter
COLUMNS = (
    'job', 'created', 'part', 'material', 'operator', 'wire_lot', 'verdict', 'rms_mm', 'share_in_tolerance', 'metal_kg',
)  # fmt: skip


class QuestionError(ValueError):
    """A filter or figure that means nothing; the text says which."""


class ArchivePage:
    """Answers questions one after the other. folder: of the jobs; the archive lies in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._archive: Archive | None = None
        self._lock = threading.Lock()

    def answer(self, asked: Mapping[str, str], look: bool) -> dict[str, Any]:
        """Figures that can be charted, rows of the newest jobs, how many there are, the chart. For JSON.

        asked: `figure`, `since` and FILTERS. look: take in the new jobs of the folder first. Raises QuestionError, and
        ArchiveError when the archive is damaged.
        """
        from waam_archive.archive import Archive
        from waam_archive.ingest import Outcome, ingest
        from waam_archive.metrics import METRICS
        from waam_archive.values import plain

        figure = asked.get('figure') or 'rms'
        if figure not in METRICS:
            raise QuestionError(f'there is no figure {figure[:MAX_FILTER_LENGTH]!r}')
        chosen = selection(asked)
        with self._lock:
            archive = self._archive = self._archive or Archive(self.folder / 'archive')
            outcome = Outcome()
            if look and self.folder.is_dir():
                outcome = ingest(archive.store, [self.folder], named=False)
            jobs = archive.jobs(chosen)
            chart = self._chart(archive, figure, chosen)
        rows = [{c: j[c] for c in COLUMNS} | {'report': self._report(j)} for j in jobs[:SHOWN]]
        figures = [[name, m.text, m.unit] for name, m in METRICS.items()]
        said = [*outcome.refused, *outcome.notes]
        return plain(
            {'figures': figures, 'count': len(jobs), 'jobs': rows, 'chart': chart, 'said': said}
        )

    @staticmethod
    def _chart(archive: Archive, figure: str, chosen: Selection) -> dict[str, Any]:
        """The newest POINTS of the figure with their limits and rules; `message` instead, when there are too few."""
        from waam_archive.charts import ChartError, chart
        from waam_archive.trend import values_of

        jobs, _, values = values_of(archive, figure, chosen)
        try:
            found = asdict(chart(values[-POINTS:]))
        except ChartError as e:
            return {'message': str(e)}
        kept = {k: found[k] for k in ('means', 'center', 'lower', 'upper', 'signals')}
        return kept | {'jobs': [str(job) for job in jobs[-POINTS:]]}

    def _report(self, job: Mapping[str, Any]) -> str:
        """Where the panel shows the report of a job, '' when it lies elsewhere or there is none."""
        source, root = Path(str(job['source'])), self.folder.resolve()
        if not job['has_report'] or root not in source.parents[:2]:
            return ''
        return f'/jobs/{source.relative_to(root).as_posix()}/report.html'


def selection(asked: Mapping[str, str]) -> Selection:
    """Filters of a request. A text without * and ? is looked for anywhere. Raises QuestionError."""
    from waam_archive.selection import NONE, Selection, SelectionError, moment

    long = [n for n in (*FILTERS, 'since') if len(asked.get(n, '')) > MAX_FILTER_LENGTH]
    if long:
        raise QuestionError(f'{long[0]}: longer than {MAX_FILTER_LENGTH} letters')
    texts = {}
    for name in FILTERS:
        text = asked.get(name, '').strip()
        whole = not text or text == NONE or '*' in text or '?' in text
        texts[name] = text if whole else f'*{text}*'
    try:
        since = asked.get('since', '').strip()
        begin = moment(since, datetime.now(UTC).replace(tzinfo=None)) if since else None
    except SelectionError as e:
        raise QuestionError(str(e)) from None
    return Selection(**texts, since=begin, until=None)
