/* From the words of G2 and G3 to an arc. */
#ifndef WAAM_ARCS_H
#define WAAM_ARCS_H

#include "waam_gcode.h"
#include "waam_path.h"

/* The arc from start to end (machine mm). Refuses start and end at different distances from the centre, and no radius. */
bool waam_arc_path(const double start_mm[WAAM_AXES], const double end_mm[WAAM_AXES], const waam_command_t *command,
                   waam_path_t *path, waam_error_t *error);

#endif
