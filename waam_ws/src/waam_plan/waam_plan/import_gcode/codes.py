"""Codes of RS274/NGC that the reader knows by their name: moves, modal groups, what is passed over or refused."""

MOVES = ('G0', 'G1', 'G2', 'G3')
# modal groups, of each at most one code in a line
GROUPS = (
    (*MOVES, 'G80'),
    ('G17', 'G18', 'G19'),
    ('G20', 'G21'),
    ('G90', 'G91'),
    ('G90.1', 'G91.1'),
    ('M3', 'M4', 'M5'),
)
# modes that every program here has, and what the machine decides for itself
QUIET = {'G40', 'G49', 'G50', 'G54', 'G61', 'G61.1', 'G64', 'G94', 'G97'}
WHY_NOT = {
    'G5': 'splines are not read, let the CAM system write arcs or lines',
    'G41': 'cutter compensation belongs into the CAM system',
    'G42': 'cutter compensation belongs into the CAM system',
    'G43': 'there is one tool; a dialect may ignore the code',
    **{
        f'G{n:g}': 'there is one work zero (G54)'
        for n in (52, 55, 56, 57, 58, 59, 59.1, 59.2, 59.3)
    },
    'G93': 'write speeds as units per minute (G94)',
    'G95': 'write speeds as units per minute (G94)',
    'G10': 'a program does not move the work zero',
    'M0': 'a job does not stop in the middle of a layer; a dialect may ignore the code',
    'M1': 'a job does not stop in the middle of a layer; a dialect may ignore the code',
}

OTHER_AXES = 'ABCUVW'  # of machines with more than X, Y and Z
HOMING = 'ELOPRT'  # words of G28 on printers: how, not where to
