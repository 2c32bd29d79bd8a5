// The number that the flash's maker gave to the flash: an RP2040 has none of its own.
#ifndef FMFTS_RP2040_BOARD_ID_H
#define FMFTS_RP2040_BOARD_ID_H

#include <stdint.h>

#include "usb_serial.h"

// Zeros if the flash has none. Call it before interrupts are enabled: the program in flash cannot be read meanwhile.
void board_id_read(uint8_t id[BOARD_ID_SIZE]);

#endif
