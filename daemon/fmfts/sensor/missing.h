/* Which sensors of a frame cannot be used, and why: silent, saturated on an axis, telling what the chip cannot, or stuck. */
#ifndef FMFTS_MISSING_H
#define FMFTS_MISSING_H

#include <stdbool.h>

#include "../common/text.h"
#include "reading.h"

/* What a person reads of a chip. saturated: by gain code, what follows the axes; unusable: the same of a count that it has not. */
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

/* Whether anything is wrong with the sensor. */
bool fmfts_is_missing(const fmfts_missing *missing, int sensor);

/* Appends what is wrong with the sensor, to follow "sensor 1 is ". False, and nothing is appended, if nothing is. */
bool fmfts_say_missing(const fmfts_missing *missing, int sensor, fmfts_text *text);

#endif
