/* The contact carried on to the time of publishing: now.py. */
#include "now.h"

#include <math.h>

enum { FORCE = 2 /* and the shears after it */ };

void fmfts_shrink(const fmfts_now_parameters *parameters, double moving, fmfts_contact_now *now)
{
    for (int i = 0; i < now->outputs; i++) {
        double prior = parameters->usual_rate[i] * parameters->usual_rate[i], variance = now->rate_deviation[i];
        double share = prior / (prior + variance);
        now->rate[i] *= share;
        now->rate_deviation[i] =
            sqrt(variance * share + moving * parameters->ahead_s[0] * parameters->acceleration_power[i]);
    }
}

void fmfts_carry(const fmfts_now_parameters *parameters, double lead_s, bool pressed, fmfts_contact_now *now)
{
    for (int i = 0; i < now->outputs; i++) {
        now->value[i] += i >= FORCE ? parameters->lead_share[0] * lead_s * now->rate[i] : now->rate[i] * lead_s;
        now->deviation[i] += now->rate_deviation[i] * lead_s;
    }
    now->value[FORCE] = fmax(now->value[FORCE], 0.0);
    if (!pressed) {
        now->value[FORCE] = now->rate[FORCE] = 0.0;
    }
}
