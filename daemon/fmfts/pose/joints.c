#include "joints.h"

#include <math.h>

/* The field is extrapolated along its last rate for this long, then held. */
static const double GOES_ON_S = 0.1;
/* A time stamp that is further ahead of a frame comes from another clock. */
static const double AHEAD_S = 0.5;
/* The error of a time stamp, and the share of the change since the newest position that the last rate does not predict.
 * */
static const double STAMP_S = 3e-3, UNFORESEEN = 0.5;

fmfts_posture fmfts_posture_at(double newest, double later_s)
{
    if (newest == FMFTS_POSTURE_UNTAUGHT || newest == FMFTS_POSTURE_ANY) {
        return newest == FMFTS_POSTURE_ANY ? FMFTS_POSTURE_ANY : FMFTS_POSTURE_UNTAUGHT;
    }
    if (newest == FMFTS_POSTURE_NO_JOINTS || isnan(later_s)) {
        return FMFTS_POSTURE_NO_JOINTS;
    }
    if (later_s > FMFTS_SILENT_S) {
        return FMFTS_POSTURE_SILENT;
    }
    if (later_s < -AHEAD_S) {
        return FMFTS_POSTURE_AHEAD;
    }
    if (newest == FMFTS_POSTURE_NO_REST) {
        return FMFTS_POSTURE_NO_REST;
    }
    return newest == FMFTS_POSTURE_KNOWN ? FMFTS_POSTURE_KNOWN : FMFTS_POSTURE_OUTSIDE;
}

double fmfts_goes_on_s(double later_s)
{
    return fmin(later_s, GOES_ON_S);
}

double fmfts_unsure_s(double later_s)
{
    return STAMP_S + UNFORESEEN * fmax(later_s, 0.0);
}

void fmfts_say_posture(fmfts_posture posture, double later_s, fmfts_text *text)
{
    switch (posture) {
    case FMFTS_POSTURE_NONE:
    case FMFTS_POSTURE_KNOWN:
        break;
    case FMFTS_POSTURE_OUTSIDE:
        fmfts_say(text, "the hand is in a posture that was not taught: `fmfts-daemon baseline --posture`");
        break;
    case FMFTS_POSTURE_NO_REST:
        fmfts_say(text, "the joints of the rest recording are not known: `fmfts-daemon baseline --rest` while joint positions are "
                        "published");
        break;
    case FMFTS_POSTURE_NO_JOINTS:
        fmfts_say(text, "no joint positions have arrived: docs/scene.md says how to publish them");
        break;
    case FMFTS_POSTURE_UNTAUGHT:
        fmfts_say(text, "the field of the hand's posture was not taught: `fmfts-daemon baseline --posture`");
        break;
    case FMFTS_POSTURE_ANY:
        fmfts_say(text, "the postures change the field by too much to do without joint positions");
        break;
    case FMFTS_POSTURE_SILENT:
        fmfts_say(text, "joint positions stopped arriving %.1f s ago: start the program that publishes them", later_s);
        break;
    case FMFTS_POSTURE_AHEAD:
        fmfts_say(text, "joint positions are stamped %.1f s ahead of the frames: stamp them by this computer's monotonic clock",
                  -later_s);
        break;
    }
}
