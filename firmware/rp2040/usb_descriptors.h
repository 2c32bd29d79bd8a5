// How the board describes itself on USB: a serial port (CDC, abstract control model).
#ifndef FMFTS_RP2040_USB_DESCRIPTORS_H
#define FMFTS_RP2040_USB_DESCRIPTORS_H

#include <stddef.h>
#include <stdint.h>

enum { USB_PACKET = 64, USB_NOTICES = 1, USB_BULK = 2, USB_SERIAL_DIGITS = 16 };

// NULL if there is none. type: the high byte of wValue; number: its low byte. serial: the board's, in ASCII.
const uint8_t *usb_descriptor(uint8_t type, uint8_t number, const char serial[USB_SERIAL_DIGITS], size_t *size);

#endif
