/* A board's line while its frames pass in C: which lanes it has, and what they left unread. */
#ifndef FMFTS_BOARD_LINE_H
#define FMFTS_BOARD_LINE_H

#include "_lane.h" /* Python.h first: it chooses what the system's headers declare */

#include "../../sensor/wire/sample.h"

enum {
    FMFTS_READ_BYTES = 4096, /* all that Linux holds back of a line */
    FMFTS_ROOM = FMFTS_READ_BYTES + FMFTS_LONGEST_LINE + 1,
};

/* Where contacts go, by zmq_send of the libzmq that the socket is of; and room for what is read. */
typedef struct {
    int (*send)(void *socket, const void *data, size_t size, int flags);
    void *socket;
    uint8_t bytes[FMFTS_ROOM];
} fmfts_bus;

typedef struct {
    PyObject *lane[FMFTS_WIRE_PADS];
    int64_t heard_ns;  /* 0: no frame has passed */
    bool needs_python; /* what was left is no beginning of a frame, or there is another kind of message to tell of */
    size_t unread_bytes;
    uint8_t unread[FMFTS_ROOM]; /* what frames did not take: for Python, or the beginning of a frame */
} fmfts_board_line;

/* The frames that what was left and `size` bytes more, at most FMFTS_READ_BYTES, begin with. False and an exception where a
 * contact could not be sent. Not for a line that needs Python. */
bool fmfts_pass(fmfts_board_line *line, fmfts_bus *bus, const char *more, size_t size, int64_t arrival_ns);

/* The same of what the descriptor has to read. */
bool fmfts_serve(fmfts_board_line *line, fmfts_bus *bus, int descriptor);

#endif
