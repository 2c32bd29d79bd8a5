/* The contact, extrapolated from the newest sample to the time of publishing. With F and its rate at the newest sample,
 * `lead` seconds before:
 *
 *     force = F + LEAD_SHARE * rate * lead, and place = x + rate * lead
 *
 * A rate is shrunk by the prior of fingers' rates (deviation P): r = r' P^2 / (P^2 + s^2). Its deviation includes the
 * finger's acceleration within AHEAD_S. The deviation of an extrapolated value is s(F) + s(rate) * lead, as if both had
 * the same cause, because the filter's errors of a value and of its rate mostly do. */
#include "now.h"

#include <math.h>

enum { FORCE = 2 /* index of the force; the shears follow it */ };

#define FORCE_RATE_N_PER_S 60.0
#define PLACE_RATE_M_PER_S 0.12
/* A fast press soon reverses. With its full rate the force would overshoot a tap's peak by 0.12 N. */
#define LEAD_SHARE 0.75
/* The rates' deviations are right for clients that extrapolate the contact for this long. */
#define AHEAD_S 5e-3
#define M2_PER_MM2 1e-6

void fmfts_shrink(const fmfts_now_parameters *parameters, double moving, fmfts_contact_now *now)
{
    for (int i = 0; i < now->outputs; i++) {
        double usual = i < FORCE ? PLACE_RATE_M_PER_S : FORCE_RATE_N_PER_S, prior = usual * usual;
        double power = parameters->drive_power[i] * (i < FORCE ? M2_PER_MM2 : 1.0), variance = now->rate_deviation[i];
        double share = prior / (prior + variance);
        now->rate[i] *= share;
        now->rate_deviation[i] = sqrt(variance * share + moving * AHEAD_S * power);
    }
}

void fmfts_carry(double lead_s, bool pressed, fmfts_contact_now *now)
{
    for (int i = 0; i < now->outputs; i++) {
        now->value[i] += i >= FORCE ? LEAD_SHARE * lead_s * now->rate[i] : now->rate[i] * lead_s;
        now->deviation[i] += now->rate_deviation[i] * lead_s;
    }
    now->value[FORCE] = fmax(now->value[FORCE], 0.0);
    if (!pressed) {
        now->value[FORCE] = now->rate[FORCE] = 0.0;
    }
}
