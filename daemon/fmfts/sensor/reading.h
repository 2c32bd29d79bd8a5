/* One sensor's part of a frame: x, y, z as int16 and the age in µs as uint16, little-endian (frame.py, docs/wire.md). */
#ifndef FMFTS_READING_H
#define FMFTS_READING_H

enum { FMFTS_READING_BYTES = 8 };

#endif
