// UART0 to the host, 460800 8N1, both directions by interrupt.
#ifndef FMFTS_RP2040_SERIAL_H
#define FMFTS_RP2040_SERIAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

void serial_start(uint32_t peripheral_hz);

// Takes the whole line, or none of it and returns false. Never waits. `context` is not used.
bool serial_send(void *context, const uint8_t *line, size_t count);

// The longest contiguous run of received bytes. Call serial_drop for those that were used.
const uint8_t *serial_peek(size_t *count);
void serial_drop(size_t count);

#endif
