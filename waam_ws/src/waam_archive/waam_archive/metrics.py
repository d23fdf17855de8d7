"""What can be charted over jobs: a value per job, as an SQL expression of this software. Pure."""

from __future__ import annotations

from typing import NamedTuple

from .selection import TEXTS


class Metric(NamedTuple):
    """unit and text for people; expression: SQL over one job; tables: what it reads beside `jobs`."""

    unit: str
    text: str
    expression: str
    of_beads: bool = False


METRICS = {
    'rms': Metric('mm', 'RMS height error', 'jobs.rms_mm'),
    'share': Metric('', 'share of the judged area in tolerance', 'jobs.share_in_tolerance'),
    'efficiency': Metric('', 'metal that grew over wire fed', 'jobs.efficiency'),
    'use': Metric('', 'wanted metal over wire fed', 'jobs.material_use'),
    'deposition': Metric('kg/h', 'deposition rate per arc time', 'jobs.deposition_kg_h'),
    'strikes': Metric('', 'strikes of the arc per bead', 'jobs.strikes_per_bead'),
    'temperature': Metric('degC', 'mean temperature before a layer', 'jobs.temperature_C'),
    'defects': Metric('', 'share of judged cells out of tolerance', 'jobs.defect_share'),
    'duration': Metric('s', 'machine time', 'jobs.duration_s'),
    'current': Metric('A', 'arc current, mean over beads', 'avg(beads.current_A)', True),
    'current_spread': Metric('A', 'arc current, standard deviation over beads', 'stddev(beads.current_A)', True),
    'bead_energy': Metric('J/m', 'arc energy per length of bead', 'sum(beads.energy_J) / sum(beads.length_m)', True),
}  # fmt: skip


KEPT = 'of_jobs'  # the table that these rows make


def rows() -> str:
    """SQL: a row per job with its filters (selection.TEXTS) and the value of every figure, out of `jobs` and `beads`.

    Beads become one row per job before anything is joined: a tenth of the time of the join first.
    """
    own, of_beads = (
        ', '.join(f'{m.expression} AS "{n}"' for n, m in METRICS.items() if m.of_beads == which)
        for which in (False, True)
    )
    named = ', '.join(f'told."{n}"' for n, m in METRICS.items() if m.of_beads)
    texts = ', '.join(f'jobs."{name}"' for name in TEXTS)
    return (
        f'SELECT {texts}, jobs.created, {own}, {named} FROM jobs '
        f'LEFT JOIN (SELECT job, {of_beads} FROM beads GROUP BY job) told ON told.job = jobs.job'
    )


def query(name: str, where: str) -> str:
    """SQL: job, created, value of every job that has one, in the order of time, out of the table in memory.

    name: key of METRICS; where: of a Selection.
    """
    return (
        f'SELECT job, created, "{name}" AS value FROM {KEPT} jobs '
        f'WHERE ({where}) AND isfinite("{name}") ORDER BY created, job'
    )
