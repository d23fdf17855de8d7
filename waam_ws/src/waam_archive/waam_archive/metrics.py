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


IN_MEMORY = {False: 'trend_jobs', True: 'trend_beads'}  # of_beads -> table that `table` makes


def table(of_beads: bool) -> str:
    """SQL that makes a table in memory: a row per job with its filters (selection.TEXTS) and the value of every figure.

    Figures of the beads want the one of the jobs first. Beads become one row per job before anything is joined: a tenth
    of the time of the join first.
    """
    own = ', '.join(
        f'{m.expression} AS "{n}"' for n, m in METRICS.items() if m.of_beads == of_beads
    )
    texts = ', '.join(f'jobs."{name}"' for name in TEXTS)
    source = 'jobs'
    if of_beads:
        told = f'(SELECT job, {own} FROM beads GROUP BY job) of_job'
        own = ', '.join(f'of_job."{n}"' for n, m in METRICS.items() if m.of_beads)
        source = f'{told} JOIN {IN_MEMORY[False]} jobs ON jobs.job = of_job.job'
    query = f'SELECT {texts}, jobs.created, {own} FROM {source}'
    return f'CREATE TEMP TABLE IF NOT EXISTS {IN_MEMORY[of_beads]} AS {query}'


def query(name: str, where: str) -> str:
    """SQL: job, created, value of every job that has one, in the order of time, out of the table in memory.

    name: key of METRICS; where: of a Selection.
    """
    return (
        f'SELECT job, created, "{name}" AS value FROM {IN_MEMORY[METRICS[name].of_beads]} jobs '
        f'WHERE ({where}) AND isfinite("{name}") ORDER BY created, job'
    )
