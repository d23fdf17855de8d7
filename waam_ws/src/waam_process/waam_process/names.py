"""Names that every part of the software uses for the same thing, each list in one place.

The numbers of the states are those of the messages (`Telemetry.STATE_*`, `JobStatus`); a test compares them.
"""

from __future__ import annotations

# how a job uses what is measured: `loop_mode` of the code, `profile` of the messages and files
OPEN_LOOP, MONITOR, CLOSED_LOOP = 'open_loop', 'monitor', 'closed_loop'
LOOP_MODES = (OPEN_LOOP, MONITOR, CLOSED_LOOP)

# state of the controller; the index is its number
CONTROLLER_STATES = ('IDLE', 'RUN', 'HOLD', 'ALARM')

# phase of a job; the index is its number
JOB_STATES = (
    *('IDLE', 'VALIDATING', 'PREPARING', 'COOLING', 'SCANNING', 'CORRECTING', 'DEPOSITING'),
    *('PAUSED', 'FINISHING', 'DONE', 'FAILED', 'ABORTED'),
)
JOB_ENDED = ('DONE', 'FAILED', 'ABORTED')  # what a job ends as
INTERRUPTED = 'INTERRUPTED'  # in status.json only, written by the supervisor
JOB_RUNNING = tuple(s for s in JOB_STATES if s not in ('IDLE', *JOB_ENDED))

# what an anomaly is about: `class_name` of Anomaly.msg
ANOMALY_CLASSES = (
    *(
        'arc',
        'wire',
        'gas',
        'height',
        'temperature',
        'link',
        'scan',
        'correction',
        'node',
        'operator',
    ),
)


def controller_state(number: int) -> str:
    """Its name, or the number as text for one that this software does not know."""
    return CONTROLLER_STATES[number] if 0 <= number < len(CONTROLLER_STATES) else str(number)


def job_state(number: int) -> str:
    """Its name, or the number as text for one that this software does not know."""
    return JOB_STATES[number] if 0 <= number < len(JOB_STATES) else str(number)
