(Exported by a path workbench)
(Output Time: 2026-03-01 12:00:00)
(begin preamble)
G17 G54 G40 G49 G80 G90
G21
(begin operation: Fixture)
(machine units: mm/min)
G54
(finish operation: Fixture)
(begin operation: Profile)
(Compensated Tool Path: 1.0)
M8
G0 Z8.000
G0 X-1.500 Y1.0000000000000000222
G0 Z6.000
G1 X-1.500 Y1.000 Z-0.500 F120.000
G1 X-1.500 Y19.000 Z-0.500 F360.000
G2 X0.000 Y20.500 Z-0.500 I1.500 J0.000 F360.000
G1 X20.000 Y20.500 Z-0.500 F360.000
G0 Z8.000
M9
(finish operation: Profile)
(begin postamble)
G17 G54 G90 G80 G40
M2
