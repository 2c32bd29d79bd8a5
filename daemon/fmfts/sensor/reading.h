/* A frame's readings: of each sensor x, y, z as int16 and the age in µs as uint16, little-endian (frame.py, firmware/wire.md),
 * and how many there are at most. */
#ifndef FMFTS_READING_H
#define FMFTS_READING_H

enum {
    FMFTS_SENSORS = 16,    /* most sensors of a pad */
    FMFTS_GAIN_CODES = 32, /* most gain codes of a chip (chip.py) */
    FMFTS_READING_BYTES = 8 /* of a sensor */,
};

#endif
