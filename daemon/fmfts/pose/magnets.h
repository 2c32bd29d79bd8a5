/* Several magnets in one pad: their fields, and what a change of pose does to them. magnets.py explains it. */
#ifndef FMFTS_MAGNETS_H
#define FMFTS_MAGNETS_H

#include <stddef.h>

enum {
    FMFTS_POSE_CHANGE = 5, /* numbers of a magnet's change of pose */
    FMFTS_MOST_TOGETHER = 9,
    FMFTS_MOST_CHANGE = FMFTS_POSE_CHANGE * FMFTS_MOST_TOGETHER,
};

/* Where magnets are, [magnets][3], and the frames [magnets][3][3] of their rest; sensors' places and axes. */
typedef struct {
    size_t magnets, sensors;
    const double *position, *axis, *frame, *strength, *octupole, *place, *axes;
} fmfts_together;

/* Where a magnet is, and how it points, after a change of pose from where it rests. */
void fmfts_move_magnet(const double frame[9], const double rest[3], const double change[FMFTS_POSE_CHANGE], double position[3],
                       double axis[3]);

/* field [sensors][3], along each sensor's axes; slope [3·sensors][5·magnets]: by the changes of pose; NULL: not wanted. */
void fmfts_fields(const fmfts_together *together, double *field, double *slope);

#endif
