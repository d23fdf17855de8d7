/* What holds for the wire feeder on random jogs and orders: a jog feeds its length and never turns the wire round, the
 * command keeps to acceleration and greatest speed, and what a jog left in the motor's model never drives the wire. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "waam_wire.h"
#include "waam_core.h"

#define DT_S 1e-3
#define RUNS 4000

static waam_config_t config;
static uint64_t dice = 1;

static double chance(double low, double high) /* xorshift64* */
{
    dice ^= dice >> 12, dice ^= dice << 25, dice ^= dice >> 27;
    return low + (high - low) * (double)(dice * 0x2545F4914F6CDD1Du >> 11) * 0x1p-53;
}

static void require(bool holds, const char *what, double got)
{
    if (holds)
        return;
    printf("wire: %s: %g\n", what, got);
    exit(1);
}

/* One tick with the bounds of the feeder; returns the length fed. */
static double tick(waam_wire_t *wire, double wanted_mm_s)
{
    double before = wire->speed_mm_s;
    waam_wire_tick(wire, wanted_mm_s, &config, DT_S);
    double after = wire->speed_mm_s;
    require(isfinite(after) && fabs(after) <= config.wire_max_mm_s + 1e-9, "speed", after);
    require(fabs(after - before) <= config.wire_accel_mm_s2 * DT_S + 1e-9, "acceleration", after - before);
    return 0.5 * (before + after) * DT_S;
}

/* To the end, or for a part of it; never against its direction nor faster than asked. */
static double run_jog(waam_wire_t *wire, double length_mm, double speed_mm_s, int most_ticks)
{
    double sign = length_mm < 0.0 ? -1.0 : 1.0, fed = 0.0;
    waam_wire_jog(wire, length_mm, speed_mm_s);
    for (int i = 0; waam_wire_jogging(wire) && i < most_ticks; i++) {
        fed += tick(wire, 0.0);
        require(sign * wire->speed_mm_s >= 0.0, "a jog never turns round", wire->speed_mm_s);
        require(sign * wire->speed_mm_s <= speed_mm_s + 1e-9, "speed of a jog", wire->speed_mm_s);
    }
    return fed;
}

/* Nothing is wanted: the command goes to rest without turning round and stays there, whatever the motor still does. */
static double rest(waam_wire_t *wire)
{
    double fed = 0.0;
    for (int i = 0; i < 400; i++) {
        double before = wire->speed_mm_s;
        fed += tick(wire, 0.0);
        require(fabs(wire->speed_mm_s) <= fabs(before) && wire->speed_mm_s * before >= 0.0, "at rest", wire->speed_mm_s);
    }
    require(wire->speed_mm_s == 0.0, "comes to rest", wire->speed_mm_s);
    return fed;
}

static void jogs(void)
{
    for (int i = 0; i < RUNS; i++) {
        waam_wire_t wire = {.motor_mm_s = chance(-100.0, 100.0)};
        double length = pow(10.0, chance(-2.0, 2.0)) * (i % 2 ? -1.0 : 1.0), speed = pow(10.0, chance(-0.5, 2.4));
        if (fabs(length) / speed > 3.0)
            continue;
        double fed = run_jog(&wire, length, speed, 1000000);
        require(!waam_wire_jogging(&wire), "a jog ends", length);
        fed += rest(&wire);
        require(fabs(fed - length) <= 2e-3 + 1e-6 * fabs(length), "length of a jog, mm off", fed - length);
    }
}

static void stopped_jogs(void)
{
    for (int i = 0; i < RUNS; i++) {
        waam_wire_t wire = {0};
        run_jog(&wire, i % 2 ? -100.0 : 100.0, chance(1.0, 300.0), 1 + (int)chance(0.0, 400.0));
        waam_wire_stop_jog(&wire);
        rest(&wire);
    }
}

/* A new speed after anything: in the end the command is what was asked for; from rest the motor does not pass it. */
static void orders(void)
{
    for (int i = 0; i < RUNS; i++) {
        waam_wire_t wire = {0};
        run_jog(&wire, i % 2 ? -50.0 : 50.0, chance(1.0, 300.0), 1 + (int)chance(0.0, 300.0));
        waam_wire_stop_jog(&wire);
        for (int order = 0; order < 3; order++) {
            double wanted = chance(0.0, 300.0), side = wanted - wire.motor_mm_s;
            for (int k = 0; k < 1500; k++) {
                double before = wire.speed_mm_s;
                tick(&wire, wanted);
                require(before < 0.0 || wire.speed_mm_s >= 0.0, "a lead never turns the wire round", wire.speed_mm_s);
                double past = side > 0.0 ? wire.motor_mm_s - wanted : wanted - wire.motor_mm_s;
                require(order == 0 || past <= 0.02 * wanted + 0.5, "the motor passes the order", past);
            }
            require(fabs(wire.speed_mm_s - wanted) <= 1e-9, "the command stands still", wire.speed_mm_s - wanted);
        }
    }
}

int main(void)
{
    config = waam_config_default();
    jogs();
    stopped_jogs();
    orders();
    printf("%d jogs, stops and orders\n", 3 * RUNS);
    return 0;
}
