/* The effect of one finger on the poses of several magnets, by a table of presses: array_response.py has the equation.
 * */
#ifndef FMFTS_PRESS_TABLE_H
#define FMFTS_PRESS_TABLE_H

#include <stdbool.h>

#include "../pose/magnets.h"

enum {
    FMFTS_TABLE_TERMS = 8,
    FMFTS_FINGER = 3,  /* x, y in mm, force in N */
    FMFTS_PRESSED = 7, /* numbers of a press for each number of pose: change 1, slope 3, shear 2, Laplacian 1 */
};

/* table: [width][width][terms + 2][poses]; width: knots along an axis, and two. */
typedef struct {
    size_t width, terms, poses;
    double first_mm, spacing_mm, scale_n;
    const double *table;
} fmfts_press_table;

/* pressed: change [poses], slope [poses][3], by_shear [poses][2] and laplacian [poses], one after the other; the last
 * two only with_shear. */
void fmfts_press_by_table(const fmfts_press_table *table, const double finger[FMFTS_FINGER], bool with_shear, double *pressed);

#endif
