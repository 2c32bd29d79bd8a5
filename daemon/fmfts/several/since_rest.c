/* The change of the magnets' field since rest, and its variance: since_rest.py explains it. */
#include "since_rest.h"

#include <math.h>

#include "../pose/push.h"

bool fmfts_since_rest(size_t values, const fmfts_rest_samples *s, const fmfts_rest_change *found)
{
    bool has_jumped = false;
    for (size_t v = 0; v < values; v++) {
        found->there[v] = isfinite(s->field_t[v]) && (double)s->repeats[v] <= s->allowed[v];
        double now = s->now_t ? fabs(s->now_t[v]) : 0.0, own = (found->there[v] ? s->field_t[v] : 0.0) / s->gain[v] - s->offset_t[v];
        found->recent_t[v] = (found->recent_t[v] > now ? found->recent_t[v] : now) / s->decay;
        double before = found->recent_t[v] - now;
        double noise = s->noise_t[v] * s->noise_share[v / 3] / s->gain[v];
        double bend = isfinite(s->bend_t[v]) ? s->bend_t[v] : 0.0, left = s->creep * (before > 0.0 ? before : 0.0);
        if (s->foreign_t) {
            own -= s->foreign_t[v];
        }
        has_jumped = has_jumped || s->bend_t[v] > FMFTS_JUMP_T / 2.0;
        found->change_t[v] = own / s->moment - s->rest_t[v];
        found->variance_t2[v] = (noise * noise + bend * bend) + left * left;
    }
    return has_jumped;
}
