/* Limits that C and Python both need; _alignment.c exports them. */
#ifndef FMFTS_POSE_LIMITS_H
#define FMFTS_POSE_LIMITS_H

/* A position with a larger deviation cannot be used: contact is not linear over it. */
#define FMFTS_VAGUE_M 1e-3
/* The largest speed of a magnet in a tap of 1 N in 50 ms: it bounds the movement since the magnet was seen. */
#define FMFTS_SPEED_M_PER_S 0.02
#define FMFTS_TURN_RAD_PER_S 2.0
/* A magnet that was not seen for long is still in its pad: the paper's hardest press moves it by 1.2 mm and 0.2 rad. */
#define FMFTS_REACH_M 1.2e-3
#define FMFTS_REACH_RAD 0.2
/* The smallest deviation of a neighbour's log moment: it warms between two temperatures, and its octupole is neglected.
 * */
#define FMFTS_MOMENT_DEVIATION 1e-3

#endif
