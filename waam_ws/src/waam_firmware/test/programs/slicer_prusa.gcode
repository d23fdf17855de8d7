; written by hand in the manner of a slicer
; perimeters extrusion width = 0.45mm
M82 ; absolute lengths of wire
W0
G21 ; set units to millimeters
G90 ; use absolute coordinates
G92 E0.0
G1 Z15.0 F9000
G92 E0
;LAYER_CHANGE
;Z:0.2
G0 X10 Y10
M104 S215 ; set temperature
G28
