"""What can be charted over jobs: a value per job, as an SQL expression of this software. Pure."""

from __future__ import annotations

from typing import NamedTuple


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


def query(metric: Metric, where: str) -> str:
    """SQL: job, created, value of every job that has one, in the order of time. where: of a Selection."""
    if not metric.of_beads:
        return (
            f'SELECT job, created, {metric.expression} AS value FROM jobs '
            f'WHERE ({where}) AND isfinite({metric.expression}) ORDER BY created, job'
        )
    # beads become one row per job before anything is joined: a tenth of the time of the join first
    return (
        f'SELECT jobs.job, jobs.created, of_job.value FROM (SELECT job, {metric.expression} AS value FROM beads '
        'GROUP BY job) of_job JOIN jobs ON jobs.job = of_job.job '
        f'WHERE ({where}) AND isfinite(of_job.value) ORDER BY jobs.created, jobs.job'
    )
