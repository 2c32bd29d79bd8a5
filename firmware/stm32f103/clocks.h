// The clocks: 72 MHz from an 8 MHz crystal, or 64 MHz from the internal oscillator when the crystal does not start.
#ifndef FMFTS_CLOCKS_H
#define FMFTS_CLOCKS_H

#include <stdint.h>

struct clocks {
    uint8_t source; // enum clock_source
    uint8_t core_mhz; // AHB and APB2, which feeds USART1
    uint8_t apb1_mhz; // feeds both I2C
};

// Also starts the microsecond timer.
struct clocks clocks_start(void);

#endif
