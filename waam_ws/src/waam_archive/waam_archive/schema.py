"""The tables of the archive: every column with its kind and meaning. doc/tables.md prints the same; a test compares.

Units stand in the names: `_mm`, `_m`, `_s`, `_A` ... A value that is not known is NULL.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from waam_process.loop_mode import OLD_FIELD
from waam_process.names import ANOMALY_CLASSES

VERSION = 3  # of the tables below; every segment of an archive says with which one it was written
FIRST_VERSION = 1  # the oldest one that can be read
RENAMED = {
    ('jobs', 'loop_mode'): (1, OLD_FIELD)
}  # column -> last version with its old name, old name
SQL_TYPES = {
    'text': 'VARCHAR', 'int': 'BIGINT', 'float': 'DOUBLE', 'bool': 'BOOLEAN', 'time': 'TIMESTAMP', 'floats': 'FLOAT[]',
}  # fmt: skip


class Column(NamedTuple):
    """name; kind: key of SQL_TYPES; text: meaning and unit."""

    name: str
    kind: str
    text: str


def _columns(kind: str, /, **texts: str) -> list[Column]:
    return [Column(name, kind, text) for name, text in texts.items()]


JOB = Column('job', 'text', 'id of the job')
_JOBS = [
    JOB,
    *_columns(
        'text',
        sha256='hash of what was ingested: names and contents of the files of the job',
        source='path that it was ingested from',
        kind='`folder` (job folder); `record` (MCAP alone) up to 0.3',
    ),
    *_columns('time', created='when the job ended or, without a report, began (UTC)'),
    *_columns(
        'text',
        name='short name', part='file name of the nominal part', part_sha256='hash of that file',
        material='key of the material table', mode='`restore` or `build`',
        loop_mode='`open_loop`, `monitor` or `closed_loop`',
        cell='name of the cell (waam up --name); of the first one `simulated`, or the name of its controller',
        operator='who answered for the job',
        wire_lot='as the notes of the job say', gas='as the notes of the job say',
        state='state that the job ended in: `DONE`, `FAILED`, `ABORTED`, `INTERRUPTED`',
        verdict='`in tolerance`, `out of tolerance`, `cleans up`, `does not clean up`, `not judged: REASON`, `failed`',
        verdict_with_rim='the same words over the whole region', message='last message of the job',
        software='revision of this software', controller='identity of the controller', firmware='its firmware',
    ),
    *_columns(
        'float',
        tolerance_mm='allowed deviation', rms_mm='RMS height error of the judged area', max_mm='largest error',
        mean_mm='mean error', rms_all_mm='RMS with the rim', as_found_rms_mm='RMS before the job',
        share_in_tolerance='0..1 of the judged area', share_all_in_tolerance='0..1 with the rim',
        overrun_mm='how far metal stands over the sides, at most', area_mm2='area of the region that was laid on',
        grown_mm3='metal between first and last scan', wanted_mm3='of it, what lies below the wanted surface',
        efficiency='grown metal over wire fed, 0..1', material_use='wanted metal over wire fed, 0..1 (table 5.3)',
        wire_m='wire fed', wire_kg='wire fed', metal_kg='metal on the part by the efficiency of the material table',
        energy_J='arc energy', duration_s='machine time', arc_on_s='time with a burning arc',
        deposition_kg_h='metal on the part per hour of arc time (eq 2.15)',
        current_A='mean arc current, weighted with arc time', voltage_V='mean arc voltage, weighted with arc time',
        temperature_C='mean temperature before the layers', temperature_max_C='highest temperature before a layer',
        strikes_per_bead='strikes of the arc over beads; 1 = every arc lit at once',
        defect_share='share of judged grid cells out of tolerance or unseen, 0..1', cost='J of eq 2.4',
    ),
    *_columns(
        'int',
        error_code='of the action run_job; 0 = none', judged_cells='grid cells that were judged',
        defect_cells='of them, those above, below or unseen', layers='layers laid', beads='beads laid',
        anomalies='anomalies of any severity', faults='anomalies of severity FAULT or ALARM',
        strikes='strikes of the arc', points_dropped='scan points dropped', telemetry_lost='telemetry frames lost',
    ),
    *_columns('bool', has_report='whether the job has a report'),
]  # fmt: skip
_LAYERS = [
    JOB,
    *_columns('int', layer='from 1; of the final scan: that of the last layer', pass_number='from 1'),
    *_columns('bool', final='scan after the last layer, nothing was laid'),
    *_columns(
        'float',
        duration_s='deposition', wait_s='waited for the interpass limit', temperature_C='before the layer',
        current_A='mean, arc on', voltage_V='mean, arc on', wire_feed_m_s='mean, arc on',
        travel_speed_m_s='mean, arc on',
        heat_input_J_m='before arc efficiency', energy_J='arc energy', wire_m='wire fed', arc_on_s='burning arc',
        height_error_rms_m='surface before the layer (final: after the last) against its target',
        height_error_max_m='largest', height_error_mean_m='mean', coverage='seen share of the region, 0..1',
        psi_mean='mean correction, -1..1', k_gain='authority of the correction',
        heat_factor='of the wire feed (eq 2.19)',
        flow_factor='of the wire feed, identified', cost='J of eq 2.4',
    ),
    *_columns('text', law='correction law that answered'),
    *_columns('bool', correction_applied='closed loop', fallback='the law could not answer in full'),
    *_columns(
        'int',
        arc_starts='strikes', segments='deposit segments', clamps_speed='segments limited in speed',
        clamps_feed='limited in wire feed', clamps_voltage='limited in voltage', clamps_psi='limited in psi',
        points_dropped='scan points dropped', telemetry_lost='frames lost', faults='faults and alarms',
    ),
]  # fmt: skip
_BEADS = [
    JOB,
    *_columns('int', layer='from 1', bead='from 1 within the layer'),
    *_columns(
        'float',
        start_s='since the first telemetry of the job', arc_on_s='burning arc',
        length_m='way of the torch with the arc on',
        x_m='start, work frame', y_m='start', z_m='start', current_A='mean', voltage_V='mean', wire_feed_m_s='mean',
        travel_speed_m_s='mean', heat_input_J_m='mean of current times voltage over speed', energy_J='arc energy',
        wire_m='wire fed', temperature_C='at its start',
    ),
    *_columns('int', strikes='strikes seen at 10 Hz; 0 = it went on from the bead before'),
    *_columns('text', numbered='where the number is from: `plan`, or `arc` (arcs counted per layer)'),
]  # fmt: skip
_ANOMALIES = [
    JOB,
    *_columns('int', number='from 1 in the job', layer='0 = before the first', bead='0 = none'),
    *_columns('float', time_s='ROS time', x_m='work frame', y_m='work frame', z_m='work frame'),
    *_columns(
        'text',
        severity='`INFO`, `WARNING`, `FAULT`, `ALARM`', class_name=', '.join(ANOMALY_CLASSES),
        text='what was found', reaction='what the system did',
    ),
]  # fmt: skip
_CALIBRATION = [
    JOB,
    *_columns(
        'text',
        file='of the scanner; empty = mounting from parameters', date='ISO 8601', sha256='of the file',
        artefact='what it was measured on', trouble='why the file says nothing',
    ),
    *_columns('float', age_days='at the end of the job'),
    *_columns('floats', mount_xyz_m='place of the scanner', mount_rpy_rad='its orientation'),
]  # fmt: skip
_CONSUMABLES = [
    JOB,
    *_columns(
        'text',
        kind='`wire` or `gas`',
        material='of the wire',
        lot='lot of the wire, name of the gas',
    ),
    *_columns('float', used_m='wire fed', used_kg='wire fed', used_s='time with a burning arc'),
]
_REPORTS = [JOB, *_columns('text', report='report.json as it was', asked='job.yaml as it was')]
TABLES: dict[str, list[Column]] = {
    'jobs': _JOBS, 'layers': _LAYERS, 'beads': _BEADS, 'anomalies': _ANOMALIES, 'calibration': _CALIBRATION,
    'consumables': _CONSUMABLES, 'reports': _REPORTS,
}  # fmt: skip


def names(table: str) -> list[str]:
    """Columns of a table, in their order."""
    return [c.name for c in TABLES[table]]


def select_list(table: str, version: int = VERSION) -> str:
    """The columns as SQL, out of files of that version of the schema."""
    found = []
    for name in names(table):
        last, old = RENAMED.get((table, name), (0, ''))
        found.append(f'"{old}" AS "{name}"' if version <= last else f'"{name}"')
    return ', '.join(found)


def version_of(columns: Iterable[str]) -> int:
    """Version of the schema whose table `jobs` has these columns."""
    old = [
        last for (table, _), (last, name) in RENAMED.items() if table == 'jobs' and name in columns
    ]
    return min(old, default=VERSION)


def markdown() -> str:
    """The tables as doc/tables.md prints them."""
    lines: list[str] = []
    for table, columns in TABLES.items():
        lines += [f'### {table}', '', '| column | type | meaning |', '|---|---|---|']
        lines += [f'| `{c.name}` | {SQL_TYPES[c.kind]} | {c.text} |' for c in columns] + ['']
    return '\n'.join(lines)
