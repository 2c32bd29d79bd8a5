// Which pins this firmware takes on each board: `make rp2040` for a Raspberry Pi Pico, `make rp2040 RP2040_BOARD=qtpy`
// for an Adafruit QT Py RP2040.
#ifndef FMFTS_RP2040_PINS_H
#define FMFTS_RP2040_PINS_H

#ifdef FMFTS_QTPY
#define PIN_SDA_1 24 // pad SDA
#define PIN_SCL_1 25 // pad SCL
#define PIN_RESET_1 26 // pad A3
#define PIN_SDA_2 22 // the STEMMA QT socket
#define PIN_SCL_2 23
#define PIN_RESET_2 27 // pad A2
#define PIN_LOAD_CELL_DATA 4 // pad MI
#define PIN_LOAD_CELL_CLOCK 6 // pad SCK
// The Pico SDK lets the crystals of this maker's boards take 64 times as long.
#define CRYSTAL_STARTUP (64 * 47)
#else
#define PIN_SDA_1 4
#define PIN_SCL_1 5
#define PIN_RESET_1 8
#define PIN_SDA_2 6
#define PIN_SCL_2 7
#define PIN_RESET_2 9
#define PIN_LOAD_CELL_DATA 10
#define PIN_LOAD_CELL_CLOCK 11
#define CRYSTAL_STARTUP 47 // times 256 cycles: 1 ms
#endif

#endif
