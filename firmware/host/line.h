// The serial line of the host build: a pty. When nobody reads, it drops whole packets, as the chip's UART does.
#ifndef FMFTS_HOST_LINE_H
#define FMFTS_HOST_LINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "../core/ring.h"

struct line {
    int master;
    char path[64];
    bool open; // some process has the other side open
    bool cut_next; // send only the first half of the next packet
    size_t sent; // bytes written since line_open
    struct ring ring;
    uint8_t bytes[4096];
};

// Opens the pty in raw mode. -1 with errno set when that fails.
int line_open(struct line *line);

// The core's `send`: takes the whole line, or none of it and returns false.
bool line_send(void *context, const uint8_t *bytes, size_t count);

// Moves waiting bytes into the pty, and checks whether the other side is open. Never blocks.
void line_flush(struct line *line);

// Calls `pass`, which sends bytes, and returns when the other side can read them: the kernel hands them over some time
// later, and much later on a busy computer.
void line_flush_during(struct line *line, void (*pass)(void *context), void *context);

// Bytes from the other side; 0 when there are none. Never blocks.
size_t line_receive(struct line *line, uint8_t *bytes, size_t count);

#endif
