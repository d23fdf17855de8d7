/* Settings of the input shaper (the commanded motion filtered so that it leaves a mode of the machine at rest): data only. */
#ifndef WAAM_SHAPER_SETTINGS_H
#define WAAM_SHAPER_SETTINGS_H

#include <stdint.h>

#define WAAM_SHAPED_AXES 2 /* X and Y; Z and the shaped axes are delayed so that they stay together */

typedef enum {
    WAAM_SHAPER_NONE,
    WAAM_SHAPER_ZV,
    WAAM_SHAPER_ZVD,
    WAAM_SHAPER_MZV,
    WAAM_SHAPER_EI,
    WAAM_SHAPER_2HUMP_EI,
    WAAM_SHAPER_3HUMP_EI,
    WAAM_SHAPER_TYPES
} waam_shaper_type_t;

typedef struct {
    uint32_t type;              /* waam_shaper_type_t */
    float hz, damping;          /* of the mode: frequency without damping, damping ratio */
} waam_shaper_axis_t;

typedef struct {
    waam_shaper_axis_t axis[WAAM_SHAPED_AXES];
    float corner_mm;            /* how far a corner may be rounded by it */
} waam_shaper_config_t;

#endif
