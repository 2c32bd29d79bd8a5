/* What is known of a hand's posture at the time of a frame: for posture.c, and through _alignment.c for hand.py. */
#ifndef FMFTS_JOINTS_H
#define FMFTS_JOINTS_H

#include "../common/text.h"

/* Joint positions older than this are unknown. */
#define FMFTS_SILENT_S 0.25

/* What is known of a posture. ANY: no joints are published, so the posture may be any recorded one. OUTSIDE: the
 * posture is none of the recorded ones. NO_REST: the posture of the rest recording is unknown. SILENT, AHEAD: the
 * newest joint positions are too old, or stamped by another clock. The other values but NONE are also states of a
 * hand's table. */
typedef enum {
    FMFTS_POSTURE_NONE, /* the pad is on no hand that moves */
    FMFTS_POSTURE_KNOWN,
    FMFTS_POSTURE_OUTSIDE,
    FMFTS_POSTURE_NO_REST,
    FMFTS_POSTURE_NO_JOINTS,
    FMFTS_POSTURE_UNTAUGHT,
    FMFTS_POSTURE_ANY,
    FMFTS_POSTURE_SILENT,
    FMFTS_POSTURE_AHEAD,
} fmfts_posture;

/* newest: state of the hand's table. later_s: the frame's time since the newest joint positions; NaN: none came. */
fmfts_posture fmfts_posture_at(double newest, double later_s);

/* For how long the field is extrapolated along its last rate. */
double fmfts_goes_on_s(double later_s);

/* The deviation of the field is its rate times this. */
double fmfts_unsure_s(double later_s);

/* Appends why a posture is not known, and what to do; nothing for KNOWN and NONE. */
void fmfts_say_posture(fmfts_posture posture, double later_s, fmfts_text *text);

#endif
