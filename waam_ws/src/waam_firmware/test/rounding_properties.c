/* Corners under the input shaper, in the whole controller: random shapers, allowed errors, speeds, overrides and turns. The
 * shaped path passes every corner within shape_corner_mm, whether the next line is known early, late, or only when the queue
 * has run empty; it ends exactly; and along curves it stays as near. A failed property prints the program's number. */
#include <math.h>

#include "random_programs.h"

#define CORNERS 6
#define PLACES 200000
#define STEP_MM (1.0 / 320)

static uint32_t slowed;
static double place[PLACES][2];
static uint32_t places;

static void require(bool condition, const char *what, double got, double limit)
{
    if (condition)
        return;
    const waam_shaper_config_t *c = &core->config.shaper;
    fprintf(stderr, "program %u (%s %.2f Hz, %s %.2f Hz, %.3f mm), line %u: %s: %.6g, limit %.6g\n", (unsigned)number,
            waam_shaper_name(c->axis[0].type), (double)c->axis[0].hz, waam_shaper_name(c->axis[1].type),
            (double)c->axis[1].hz, (double)c->corner_mm, (unsigned)core->executed, what, got, limit);
    exit(1);
}

static void tick(void)
{
    beat();
    host_harness_tick(&machine);
    require(places < PLACES, "the path does not end", places, PLACES);
    for (int i = 0; i < 2; i++)
        place[places][i] = STEP_MM * (waam_core_steps(core, i) + (double)core->part[i] / WAAM_PARTS);
    places++;
}

static void settle(void)
{
    for (int rests = 0; rests < 150; rests = core->state == WAAM_IDLE && !core->planner.count ? rests + 1 : 0)
        tick();
}

static void set(const char *name, double value)
{
    char text[60];
    snprintf(text, sizeof text, "$C %s %.4f", name, value);
    feed(text);
}

static void start(void)
{
    machine = (host_harness_t){.config = waam_config_default(), .null_plant = true, .start_mm = {1.0, 1.0, 199.0}};
    machine.config.starts_in_alarm = false;
    host_harness_source(&machine, TICK_US);
    waam_core_init(core, &machine.config, on_line, NULL);
    next_line = 1, places = 0;
    feed("$I");
    set("shape_x_hz", uniform(16.0, 100.0)), set("shape_y_hz", uniform(16.0, 100.0));
    set("shape_x_damping", uniform(0.0, 0.2)), set("shape_y_damping", uniform(0.0, 0.2));
    set("shape_corner_mm", exp(uniform(log(0.005), log(0.2))));
    set("shape_x", 1 + number % 6), set("shape_y", number % 4 ? floor(uniform(0.0, 6.99)) : 0);
    send("G28");
    settle();
    send("G0 X150 Y150 Z150");
    settle();
    places = 0;
}

static double hypot2(const double a[2], const double b[2]) { return hypot(a[0] - b[0], a[1] - b[1]); }

/* Distance of `p` from the line from a to b. */
static double off_line(const double p[2], const double a[2], const double b[2])
{
    double way[2] = {b[0] - a[0], b[1] - a[1]}, square = way[0] * way[0] + way[1] * way[1];
    double share = square > 0.0 ? ((p[0] - a[0]) * way[0] + (p[1] - a[1]) * way[1]) / square : 0.0;
    share = fmin(1.0, fmax(0.0, share));
    const double at[2] = {a[0] + share * way[0], a[1] + share * way[1]};
    return hypot2(p, at);
}

/* Nearest distance of the path run so far from `corner`. */
static double nearest(const double corner[2])
{
    double least = INFINITY;
    for (uint32_t k = 1; k < places; k++)
        least = fmin(least, off_line(corner, place[k - 1], place[k]));
    return least;
}

/* Legs of 4 mm and more, so that corners are alone. `late`: the next line comes when the one before is nearly done. */
static void corners(void)
{
    double corner[CORNERS + 1][2] = {{150.0, 150.0}}, heading = uniform(0.0, 6.283), allowed = (double)core->config.shaper.corner_mm;
    bool late = number % 3 == 0;
    char text[80];
    for (int i = 1; i <= CORNERS; i++) {
        double length = uniform(4.0, 8.0), turn = uniform(0.35, 3.1415);
        heading += uniform(0.0, 1.0) < 0.5 ? turn : -turn;
        corner[i][0] = round(320 * (corner[i - 1][0] + length * cos(heading))) / 320;
        corner[i][1] = round(320 * (corner[i - 1][1] + length * sin(heading))) / 320;
        snprintf(text, sizeof text, "G1 X%.5f Y%.5f F%.1f", corner[i][0], corner[i][1], 60.0 * exp(uniform(0.0, log(60.0))));
        send(text);
        if (late)
            for (uint32_t wait = 1; core->state != WAAM_IDLE || wait; wait = 0) {
                tick();
                if (core->planner.count == 1 && uniform(0.0, 1.0) < 0.002)
                    break;
                if (core->planner.count == 0 && uniform(0.0, 1.0) < 0.2)
                    break;
            }
        if (number % 5 == 0 && !late) {
            snprintf(text, sizeof text, "$V %.0f 1000", uniform(200.0, 2000.0));
            feed(text);
        }
    }
    settle();
    for (int i = 1; i < CORNERS; i++) {
        double far = nearest(corner[i]), most = allowed + 1.5 * STEP_MM;
        require(far <= most, "distance from a corner (mm)", far, most);
        slowed += far > 0.3 * allowed;
    }
    for (int i = 0; i < 2; i++)
        require(waam_core_steps(core, i) == lround(320 * corner[CORNERS][i]), "steps at the end", waam_core_steps(core, i),
                320 * corner[CORNERS][i]);
}

/* A half circle, as an arc or as short lines: distance from the circle in its middle part. Between the corners of a polygon
 * the speed changes, and then two axes with different shapers leave a straight line; so these two are alike. */
static void curve(void)
{
    double radius = exp(uniform(log(1.0), log(20.0))), allowed = (double)core->config.shaper.corner_mm, worst = 0.0;
    int chords = (int)ceil(3.1416 * radius / uniform(0.1, 0.6));
    char text[80];
    const waam_shaper_axis_t x = core->config.shaper.axis[0];
    if (number % 2 == 0)
        set("shape_y", 0), set("shape_y_hz", (double)x.hz), set("shape_y_damping", (double)x.damping), set("shape_y", x.type);
    places = 0;
    snprintf(text, sizeof text, "G1 X160 Y150 F3000");
    send(text);
    settle();
    places = 0;
    const double centre[2] = {160.0, 150.0 + radius};
    if (number % 2) {
        snprintf(text, sizeof text, "G3 X160 Y%.5f I0 J%.5f F%.0f", 150.0 + 2 * radius, radius, uniform(300.0, 3000.0));
        send(text);
    }
    for (int i = 1; i <= chords && number % 2 == 0; i++) {
        double angle = 3.14159265358979 * i / chords;
        while (core->planner.count > 30)
            tick();
        snprintf(text, sizeof text, "G1 X%.5f Y%.5f F2000", centre[0] + radius * sin(angle), centre[1] - radius * cos(angle));
        send(text);
    }
    settle();
    for (uint32_t k = 0; k < places; k++)
        if (place[k][0] > 160.0 + 0.3 * radius)
            worst = fmax(worst, radius - hypot2(place[k], centre));
    double bulge = number % 2 ? 0.0 : radius * (1.0 - cos(1.5708 / chords));
    require(worst <= allowed + bulge + 1.5 * STEP_MM, "distance from a circle (mm)", worst, allowed + bulge + 1.5 * STEP_MM);
}

int main(int argc, char **argv)
{
    uint32_t programs = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 60;
    for (number = argc > 2 ? (uint32_t)atoi(argv[2]) : 1; number <= programs; number++) {
        seed = number * 1000003u;
        start();
        corners();
        curve();
    }
    require(slowed > programs, "corners that were rounded at all", slowed, programs);
    printf("%u random shapers, %d corners each and a curve: all properties hold\n", (unsigned)programs, CORNERS - 1);
    return 0;
}
