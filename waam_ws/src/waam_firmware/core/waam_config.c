#include "waam_core.h"

waam_config_t waam_config_default(void)
{
    return (waam_config_t){
        .steps_per_mm = 320,
        .limit_max_mm = {400.0, 300.0, 200.0},
        .max_speed_mm_s = {200.0, 200.0, 100.0},
        .accel_mm_s2 = {500.0, 500.0, 300.0},
        .rapid_mm_s = 50.0,
        .junction_deviation_mm = 0.02,
        .home_direction = {-1, -1, 1},
        .home_seek_mm_s = 40.0,
        .home_latch_mm_s = 2.0,
        .home_backoff_mm = 1.0,
        .wire_max_mm_s = 300.0,
        .wire_accel_mm_s2 = 2000.0,
        .voltage_max_v = 60.0,
        .arc = {
            .purge_us = 300000,
            .strike_us = 1000000,
            .retry_pause_us = 300000,
            .tries = 3,
            .established_a = 30.0,
            .established_us = 20000,
            .lost_us = 200000,
            .strike_wire_factor = 0.5,
            .crater_wire_factor = 0.6,
            .crater_us = 150000,
            .burn_back_us = 60000,
            .post_flow_us = 1000000,
            .gas_missing_us = 500000,
            .wire_fault_ratio = 0.9,
            .wire_fault_us = 500000,
        },
        .link_timeout_us = 500000,
        .lease_us = 500000,
        .lease_margin_us = 10000,
        .underrun_grace_us = 20000,
        .telemetry_us = 10000,
    };
}
