/* Which sensors of a frame cannot be used, and why: silent, saturated on an axis, with an impossible count, or stuck.
 * */
#ifndef FMFTS_MISSING_H
#define FMFTS_MISSING_H

#include <stdbool.h>

#include "../common/text.h"
#include "reading.h"

/* Texts about a chip. saturated: by gain code, the words after the axes; unusable: the same for an impossible count. */
typedef struct {
    const char *saturated[FMFTS_GAIN_CODES], *untellable;
} fmfts_chip_words;

/* Of each sensor: whether it gave no sample; bit i of the others: of axis i. */
typedef struct {
    bool silent[FMFTS_SENSORS];
    unsigned char saturated[FMFTS_SENSORS], untellable[FMFTS_SENSORS], stuck[FMFTS_SENSORS];
    unsigned gain_code;
    const fmfts_chip_words *words;
} fmfts_missing;

/* Whether the sensor cannot be used fully. */
bool fmfts_is_missing(const fmfts_missing *missing, int sensor);

/* Appends what is wrong with the sensor, to follow "sensor 1 is ". False, and nothing is appended, if nothing is. */
bool fmfts_say_missing(const fmfts_missing *missing, int sensor, fmfts_text *text);

#endif
