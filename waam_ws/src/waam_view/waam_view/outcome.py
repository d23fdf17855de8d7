"""What came out of a demo on the simulated cell, in words for somebody who sees it for the first time."""

from __future__ import annotations

from typing import Any

from waam_process.loop_mode import LoopMode
from waam_process.operating import PRESETS
from waam_process.verdicts import IN_TOLERANCE, OUT_OF_TOLERANCE

from .job_data import number


def outcome(report: dict[str, Any]) -> str:
    """Of a demo's report.json; '' without a preset or without a closed loop that came to its end."""
    run = report.get(LoopMode.CLOSED_LOOP)
    preset = str(report.get('preset') or '')
    if not preset or not isinstance(run, dict) or run.get('error_code'):
        return ''
    verdict = str(run.get('verdict') or '')
    share, rms = (number(run.get(k)) for k in ('share_in_tolerance', 'rms_mm'))
    figures = (
        f'{share:.1%} of the judged area are within ±{number(report.get("tolerance_mm")):g} mm, RMS {rms:.3f} mm, '
        f"on the simulated cell '{preset}' ({PRESETS.get(preset, 'of another version')})"
    )
    if verdict == IN_TOLERANCE:
        return f'The part is in tolerance: {figures}.'
    if verdict != OUT_OF_TOLERANCE:
        return ''
    said = f'The part is OUT OF TOLERANCE: only {figures}. Nothing has failed: that is what the loop leaves there.'
    if preset == 'gentle':
        return said
    again = 'waam demo --part shaft' if run.get('shaft') else 'waam demo'
    return f'{said} `{again} --preset gentle` shows the same part on a cell that scatters less.'
