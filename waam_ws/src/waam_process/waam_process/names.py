"""Names of states, of kinds of anomalies and of choices, each list in one place (`loop_mode` has those of the loop).

The numbers of the states are those of the messages (`Telemetry.STATE_*`, `JobStatus`); a test compares them.
"""

from __future__ import annotations

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

# what the torch is held at its distance by, and the law from the error to the speed
STANDOFF_SOURCES = ('none', 'laser', 'infrared', 'arc')
STANDOFF_LAWS = ('relay', 'pid')
# signals of the part's temperature at the controller; the index is their number in $C temperature_input
TEMPERATURE_INPUTS = ('none', '0-10V', '4-20mA', 'thermocouple')

SEVERITIES = ('INFO', 'WARNING', 'FAULT', 'ALARM')  # of an anomaly; the index is its number
FAULTS = ('FAULT', 'ALARM')  # those that count as faults

# what an anomaly is about: `class_name` of Anomaly.msg
ANOMALY_CLASSES = (
    *('arc', 'wire', 'gas', 'height', 'temperature'),
    *('link', 'scan', 'correction', 'node', 'operator', 'motion'),
)
POWER_UP = 306  # fault of a controller that was just switched on
# what a fault of the controller is about, by its code (docs/link_protocol.md); all others: link
CLASS_OF_FAULT = {
    204: 'arc',
    205: 'arc',
    206: 'wire',
    207: 'gas',
    208: 'arc',
    209: 'arc',
    210: 'temperature',
    211: 'wire',
    300: 'operator',
    301: 'motion',
    302: 'motion',
    304: 'motion',
    308: 'motion',
}


def controller_state(number: int) -> str:
    """Its name, or the number as text for one that this software does not know."""
    return CONTROLLER_STATES[number] if 0 <= number < len(CONTROLLER_STATES) else str(number)


def severity(number: int) -> str:
    """Its name, or the number as text for one that this software does not know."""
    return SEVERITIES[number] if 0 <= number < len(SEVERITIES) else str(number)


def job_state(number: int) -> str:
    """Its name, or the number as text for one that this software does not know."""
    return JOB_STATES[number] if 0 <= number < len(JOB_STATES) else str(number)
