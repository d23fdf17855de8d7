; external perimeters extrusion width = 0.50mm
G21 ; set units to millimeters
G90 ; use absolute coordinates
M83 ; use relative distances
G92 E0
G1 E-2.00000 F2400.00000
G1 Z0.350 F7800.000
T0
