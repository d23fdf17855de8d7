#include "waam_smith_predictor.h"

bool waam_smith_predictor_start(waam_smith_predictor_t *smith, float lag_s, float delay_s, float sample_s)
{
    float samples = delay_s / sample_s + 0.5f;
    if (!(samples < (float)WAAM_SMITH_PREDICTOR_MAX) || samples < 0.0f)
        return false;
    *smith = (waam_smith_predictor_t){.share = sample_s / (lag_s + sample_s), .delay = (uint32_t)samples};
    return true;
}

float waam_smith_predictor_coming(const waam_smith_predictor_t *smith)
{
    return smith->now - smith->line[(smith->at + WAAM_SMITH_PREDICTOR_MAX - smith->delay) % WAAM_SMITH_PREDICTOR_MAX];
}

void waam_smith_predictor_step(waam_smith_predictor_t *smith, float output)
{
    smith->now += smith->share * (output - smith->now);
    smith->at = (smith->at + 1) % WAAM_SMITH_PREDICTOR_MAX;
    smith->line[smith->at] = smith->now;
}
