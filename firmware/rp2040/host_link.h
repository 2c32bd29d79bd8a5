// The line to the host: USB while a program there has opened the port, else UART0.
#ifndef FMFTS_RP2040_HOST_LINK_H
#define FMFTS_RP2040_HOST_LINK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "usb_serial.h"

void host_link_start(uint32_t peripheral_hz, const uint8_t id[BOARD_ID_SIZE]);

// Takes the whole line, or none of it and returns false. Never waits. `context` is not used.
bool host_link_send(void *context, const uint8_t *line, size_t count);

// Hands what the host has sent to `use`.
void host_link_receive(void (*use)(const uint8_t *bytes, size_t count));

#endif
