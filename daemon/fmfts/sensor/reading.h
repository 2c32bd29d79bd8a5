/* A frame's readings: of each sensor x, y, z as int16 and the age in µs as uint16, little-endian (frame.py, firmware/wire.md),
 * and how many there are at most. */
#ifndef FMFTS_READING_H
#define FMFTS_READING_H

enum {
    FMFTS_SENSORS = 16,    /* of a pad, at most */
    FMFTS_GAIN_CODES = 32, /* of a chip, at most (chip.py) */
    FMFTS_READING_BYTES = 8 /* of a sensor */,
};

#endif
