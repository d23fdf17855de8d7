"""What can be charted over jobs: a value per job, as an SQL expression of this software. Pure."""

from __future__ import annotations

from typing import NamedTuple


class Metric(NamedTuple):
    """unit and text for people; expression: SQL over one job; of_beads: out of its beads."""

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


def query(name: str, where: str) -> tuple[tuple[str, ...], str]:
    """The tables that a question reads, and its SQL: job, created, value of every job that has one, in the order of
    time. name: key of METRICS; where: of a Selection."""
    m = METRICS[name]
    of = 'jobs'
    value = m.expression
    if (
        m.of_beads
    ):  # one row per job before anything is joined: a tenth of the time of the join first
        of += f' JOIN (SELECT job, {value} AS value FROM beads GROUP BY job) told USING (job)'
        value = 'told.value'
    return (
        ('jobs', 'beads') if m.of_beads else ('jobs',),
        f'SELECT jobs.job, jobs.created, {value} AS value FROM {of} '
        f'WHERE ({where}) AND isfinite({value}) ORDER BY jobs.created, jobs.job',
    )
