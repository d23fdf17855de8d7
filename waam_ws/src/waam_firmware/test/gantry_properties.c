/* Random gantries through the whole controller: whatever `$C` takes of envelope, speeds, accelerations and homing, the
 * machine homes, stays within the envelope, keeps every speed, and refuses the first hundredth of a mm beyond it; what `$C`
 * refuses changes nothing. A failed property prints the program's number. */
#include <math.h>

#include "random_programs.h"
#include "waam_gantry.h"
#include "waam_scale.h"

#define LINES 6

static char refused[80]; /* the last `er` */
static double fastest_mm_s;  /* along the path */

static void require(bool condition, const char *what, double got, double limit)
{
    const waam_config_t *c = &core->config;
    if (condition)
        return;
    fprintf(stderr, "program %u (%.3f x %.3f x %.3f mm, %.1f %.1f %.1f mm/s): %s: %.6g, limit %.6g\n", (unsigned)number,
            c->limit_max_mm[0], c->limit_max_mm[1], c->limit_max_mm[2], c->max_speed_mm_s[0], c->max_speed_mm_s[1],
            c->max_speed_mm_s[2], what, got, limit);
    exit(1);
}

static void hear(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    if (bytes > 3 && !memcmp(line, "er ", 3))
        snprintf(refused, sizeof refused, "%.*s", (int)bytes, line);
    else
        on_line(context, line, bytes, kind);
}

static void tick(void)
{
    const waam_config_t *c = &core->config;
    int64_t before[WAAM_AXES];
    double way = 0.0;
    memcpy(before, machine.outputs.pulses, sizeof before);
    if (core->now_us % 50000 == 0)
        feed("$H t 0");
    host_harness_tick(&machine);
    for (int i = 0; i < WAAM_AXES; i++) {
        double steps = (double)(machine.outputs.pulses[i] - before[i]), at = waam_core_steps(core, i);
        double most = c->max_speed_mm_s[i] * 1e-3 * c->steps_per_mm[i] + 1.0;
        require(fabs(steps) <= most && most <= 1e-3 * WAAM_STEP_RATE_MOST + 1.0, "pulses in a tick", steps, most);
        require(!core->homed || (at >= -0.5 && at <= c->limit_max_mm[i] * c->steps_per_mm[i] + 0.5), "envelope", at,
                c->limit_max_mm[i] * c->steps_per_mm[i]);
        way += pow(steps / c->steps_per_mm[i], 2.0);
    }
    fastest_mm_s = fmax(fastest_mm_s, sqrt(way) * 1e3);
}

static void settle(void)
{
    for (int rests = 0; rests < 3; rests = core->state == WAAM_IDLE && !core->planner.count ? rests + 1 : 0) {
        require(core->state != WAAM_ALARM, "no alarm", core->fault, 0);
        tick();
    }
}

static bool set(const waam_setting_t *setting, double value)
{
    char text[60];
    waam_config_t before = core->config;
    bool homed = core->homed;
    snprintf(text, sizeof text, "$C %s %.3f", setting->name, value);
    feed(text);
    double now = waam_setting_get(setting, &core->config), was = waam_setting_get(setting, &before);
    bool taken = fabs(now - value) < 6e-4, moves_home = setting->name[0] == 'e' || !strncmp(setting->name, "home_d", 6);
    require(taken || !memcmp(&before, &core->config, sizeof before), "what is refused changes nothing", value, now);
    require(core->homed == (homed && (now == was || !moves_home)), "homing", core->homed, homed);
    return taken;
}

/* Nearly all within the range, some beyond; short gantries more often than long ones, for they are quick. */
static void configure(void)
{
    for (size_t k = 0; waam_gantry_settings[k].name; k++) {
        const waam_setting_t *s = &waam_gantry_settings[k];
        double low = (double)s->lowest, high = (double)s->highest, value = low * pow(high / low, uniform(0.0, 1.0));
        if (s->type == WAAM_SETTING_SIGN)
            value = uniform(0.0, 1.0) < 0.5 ? -1.0 : 1.0;
        require(!set(s, low - uniform(0.001, 1e3)) && !set(s, high + uniform(0.001, 1e6)), s->name, value, high);
        bool fits = s->type == WAAM_SETTING_SIGN || strncmp(s->name, "max_speed", 9) != 0 ||
                    round(value * 1e3) / 1e3 * core->config.steps_per_mm[s->name[10] - 'x'] <= WAAM_STEP_RATE_MOST;
        require(set(s, value) == fits, s->name, value, fits);
    }
    require(core->config.home_direction[2] == 1, "Z homes upwards", core->config.home_direction[2], 1);
}

static void start(void)
{
    machine = (host_harness_t){.config = waam_config_default(), .null_plant = true};
    machine.config.starts_in_alarm = false;
    host_harness_source(&machine, TICK_US);
    for (int i = 0; i < WAAM_AXES; i++)
        machine.config.steps_per_mm[i] = round(uniform(20.0, 770.0 / (i == 2 ? 1.0 : 2.0)) * 1e3) / 1e3;
    waam_core_init(core, &machine.config, hear, NULL);
    next_line = 1;
    feed("$I");
    configure();
    host_harness_tick(&machine); /* the machine is of that size now */
    for (int i = 0; i < WAAM_AXES; i++) {
        double far = uniform(0.1, 45.0), most = core->config.limit_max_mm[i];
        machine.start_mm[i] = core->config.home_direction[i] < 0 ? far : most - far;
    }
    send("G28");
    settle();
    for (int i = 0; i < WAAM_AXES; i++)
        require(core->homed && waam_core_steps(core, i) == (core->config.home_direction[i] < 0 ? 0 :
                lround(core->config.limit_max_mm[i] * core->config.steps_per_mm[i])), "home", waam_core_steps(core, i), 0);
}

static void moves(void)
{
    char text[100];
    for (int k = 0; k < LINES; k++) {
        double to[WAAM_AXES];
        for (int i = 0; i < WAAM_AXES; i++)
            to[i] = fmin(1.0, fmax(0.0, uniform(-0.2, 1.2))) * core->config.limit_max_mm[i];
        bool rapid = k % 2;
        snprintf(text, sizeof text, "G%d X%.4f Y%.4f Z%.4f F60000", !rapid, to[0], to[1], to[2]);
        fastest_mm_s = 0.0;
        send(text);
        settle();
        require(!refused[0], refused, 0.0, 0.0);
        double step = 1e3 / fmin(core->config.steps_per_mm[0], fmin(core->config.steps_per_mm[1], core->config.steps_per_mm[2]));
        require(!rapid || fastest_mm_s <= core->config.rapid_mm_s + 2.0 * step, "speed of G0", fastest_mm_s,
                core->config.rapid_mm_s);
    }
}

static void refuse(const char *words, const char *code)
{
    char text[40];
    int64_t before = machine.outputs.pulses[0] + machine.outputs.pulses[1] + machine.outputs.pulses[2];
    refused[0] = '\0';
    send(words);
    for (int i = 0; i < 20; i++)
        tick();
    require(strstr(refused, code) != NULL, words, 0.0, 0.0);
    require(before == machine.outputs.pulses[0] + machine.outputs.pulses[1] + machine.outputs.pulses[2], "moved", 0.0, 0.0);
    snprintf(text, sizeof text, "$L %u", (unsigned)next_line);
    feed(text);
}

static void beyond(void)
{
    char text[60];
    for (int i = 0; i < WAAM_AXES; i++) {
        double most = core->config.limit_max_mm[i], over = uniform(0.5 / core->config.steps_per_mm[i] + 1e-3, 50.0);
        snprintf(text, sizeof text, "G1 %c%.4f F600", "XYZ"[i], uniform(0.0, 1.0) < 0.5 ? most + over : -over);
        refuse(text, " E302 ");
    }
    const waam_setting_t *envelope = &waam_gantry_settings[(unsigned)uniform(0.0, 2.999)];
    require(set(envelope, waam_setting_get(envelope, &core->config)) && core->homed, "the same again", 0.0, 0.0);
    require(set(envelope, uniform(60.0, 3400.0)) && !core->homed, "another envelope loses homing", 0.0, 0.0);
    refuse("G1 X10 F600", " E304 ");
    refused[0] = '\0';
}

int main(int argc, char **argv)
{
    uint32_t programs = argc > 1 ? (uint32_t)strtoul(argv[1], NULL, 10) : 60;
    for (number = 0; number < programs; number++) {
        seed = number;
        start();
        moves();
        beyond();
    }
    printf("%u random gantries: all properties hold\n", (unsigned)programs);
    return 0;
}
