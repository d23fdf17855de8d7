"""Progress of many jobs on the screen."""

from __future__ import annotations

from waam_node.advance import Advance

from .job import LabResult


class JobAdvance(Advance):
    """Of a campaign: jobs done, and the result of the last one."""

    def __call__(self, result: LabResult) -> None:
        """One job is done."""
        self.step(f'seed {result.seed}: {result.message if result.failed else outcome(result)}')


def outcome(r: LabResult) -> str:
    """One line for the screen: error (mm), share in tolerance (%) and verdict, without and with the rim."""
    rim = f'with the rim {r.share_edges * 100:.1f} %, {r.verdict_edges}'
    return f'RMS {r.rms * 1e3:.3f} mm, {r.share_in_tolerance * 100:.1f} %, {r.verdict}; {rim}'
