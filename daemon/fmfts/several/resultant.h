/* The resultant of several fingers, and deviations as they are published. */
#ifndef FMFTS_RESULTANT_H
#define FMFTS_RESULTANT_H

#include <stddef.h>

enum { FMFTS_OF_FINGER = 3 }; /* x, y in mm, and force in N */

/* resultant.c: finger [count][3] → the place where all of the force would press, and its sum. */
void fmfts_resultant(size_t count, const double *finger, double whole[FMFTS_OF_FINGER]);

/* resultant.c: deviation [1 + count][3] of the resultant, and of each finger. covariance [3·count][3·count]: of the fingers.
 * least [1 + count][3]: variances that are at least so large (several/valley.py); NULL: none are known. */
void fmfts_finger_deviations(size_t count, const double *finger, const double *covariance, const double *least, double *deviation);

#endif
