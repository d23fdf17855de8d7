/* The accelerometer on the moving axes: switched by `$M`, its samples in lines of telemetry, its loss by name. */
#include "waam_request.h"

void waam_order_measure(waam_request_t *r)
{
    double on;
    if (!waam_request_numbers(r, &on, 1))
        return;
    if (on != 0.0 && on != 1.0) {
        waam_request_refuse(r, WAAM_E_NUMBER, "use $M 1 or $M 0");
        return;
    }
    if (!r->core->config.accelerometer) {
        waam_request_refuse(r, WAAM_E_NOT_NOW, "this controller has no accelerometer");
        return;
    }
    waam_acceleration_want(&r->core->acceleration, on == 1.0);
    waam_request_ok(r);
}

static void tell_fault(waam_core_t *core)
{
    waam_acceleration_t *a = &core->acceleration;
    if (!a->sensor.fault || a->told)
        return;
    a->told = true;
    waam_core_tell(core, WAAM_E_ACCELEROMETER, waam_adxl345_text((waam_adxl345_fault_t)a->sensor.fault));
}

/* At most one line per tick, and none beside a line of telemetry, for two are much for one tick. */
void waam_core_accelerations(waam_core_t *core)
{
    waam_text_t line = {.length = 0};
    if (core->acceleration.wanted && !core->link.known)
        waam_acceleration_want(&core->acceleration, false);
    if (!core->acceleration.wanted)
        return;
    tell_fault(core);
    if (waam_acceleration_line(&core->acceleration, core->now_us, WAAM_FAST_US, &line))
        waam_core_send(core, &line, WAAM_TX_TELEMETRY);
}

size_t waam_core_accelerometer(waam_core_t *core, const uint8_t *in, size_t count, uint8_t out[WAAM_ADXL345_BYTES])
{
    return waam_acceleration_fast(&core->acceleration, in, count, out);
}
