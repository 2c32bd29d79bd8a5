/* The change of the magnets' field since rest, and its variance: since_rest.py explains it. */
#include "since_rest.h"

#include <math.h>

void fmfts_since_rest(size_t values, const fmfts_rest_samples *s, double moment, double creep, double *change_t,
                      double *variance_t2)
{
    for (size_t v = 0; v < values; v++) {
        double own = (s->there[v] ? s->field_t[v] : 0.0) / s->gain[v] - s->offset_t[v];
        double before = s->recent_t[v] - (s->now_t ? s->now_t[v] : 0.0);
        double noise = s->noise_t[v] * s->noise_share[v / 3] / s->gain[v];
        double bend = isfinite(s->bend_t[v]) ? s->bend_t[v] : 0.0, left = creep * (before > 0.0 ? before : 0.0);
        if (s->foreign_t) {
            own -= s->foreign_t[v];
        }
        change_t[v] = own / moment - s->rest_t[v];
        variance_t2[v] = (noise * noise + bend * bend) + left * left;
    }
}

bool fmfts_list_present(size_t values, const double *field_t, const int64_t *repeats, const double *allowed, uint8_t *there)
{
    bool all = true;
    for (size_t v = 0; v < values; v++) {
        there[v] = isfinite(field_t[v]) && (double)repeats[v] <= allowed[v];
        all = all && there[v];
    }
    return all;
}
