// The board's own USB as a serial port, both directions by interrupt.
#ifndef FMFTS_RP2040_USB_SERIAL_H
#define FMFTS_RP2040_USB_SERIAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { BOARD_ID_SIZE = 8 };

// id: the board's, which it shows as its serial number.
void usb_serial_start(const uint8_t id[BOARD_ID_SIZE]);

// Whether a program on the host has opened the port.
bool usb_serial_is_open(void);

// The same as in serial.h.
bool usb_serial_send(const uint8_t *line, size_t count);
const uint8_t *usb_serial_peek(size_t *count);
void usb_serial_drop(size_t count);

#endif
