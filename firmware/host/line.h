// The serial line of the host build: a pty that drops whole packets when nobody reads, as the chip's UART would.
#ifndef FMFTS_HOST_LINE_H
#define FMFTS_HOST_LINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "../core/ring.h"

struct line {
    int master;
    char path[64];
    bool open; // somebody holds the other side
    bool cut_next;
    size_t sent; // bytes, ever
    struct ring ring;
    uint8_t bytes[4096];
};

// Opens the pty in raw mode. -1 with errno set when that fails.
int line_open(struct line *line);

// What the core calls: the whole line or nothing.
bool line_send(void *context, const uint8_t *bytes, size_t count);

// Moves waiting bytes into the pty and notices who comes and goes. Never blocks.
void line_flush(struct line *line);

// Moves them while `pass` lets time go by, and returns when the other side can read them: the kernel hands them over
// some time later, which a busy computer draws out.
void line_flush_during(struct line *line, void (*pass)(void *context), void *context);

// Bytes from the other side; 0 when there are none. Never blocks.
size_t line_receive(struct line *line, uint8_t *bytes, size_t count);

#endif
