/* Smith predictor (O. Smith 1957): the plant model k/(T s + 1) with dead time tells what is under way. */
#ifndef WAAM_SMITH_PREDICTOR_H
#define WAAM_SMITH_PREDICTOR_H

#include <stdbool.h>
#include <stdint.h>

#define WAAM_SMITH_PREDICTOR_MAX 256 /* samples of delay, less one */

typedef struct {
    float share;            /* of the way to its target that the model goes in one sample */
    uint32_t delay;         /* samples */
    uint32_t at;
    float now;              /* model without delay */
    float line[WAAM_SMITH_PREDICTOR_MAX];
} waam_smith_predictor_t;

/* Begins at rest at 0. False: the delay is longer than the line. */
bool waam_smith_predictor_start(waam_smith_predictor_t *smith, float lag_s, float delay_s, float sample_s);
/* What the measurement will gain from what has been put out and did not arrive yet. */
float waam_smith_predictor_coming(const waam_smith_predictor_t *smith);
/* The model lives through one sample; `output` is its gain times what was put out. */
void waam_smith_predictor_step(waam_smith_predictor_t *smith, float output);

#endif
