/* The serial line of a board while C handles its frames: its pads, and the bytes that they left. */
#ifndef FMFTS_BOARD_LINE_H
#define FMFTS_BOARD_LINE_H

#include "_pad.h" /* Python.h first: it chooses what the system's headers declare */

#include "../sensor/wire/newest.h"

enum {
    FMFTS_READ_BYTES = 4096, /* the most that Linux hands over of a serial line at once */
    FMFTS_ROOM = 3 * FMFTS_READ_BYTES,
    /* Number of messages that are sent together: ZeroMQ's thread, once awake, writes all of them at once. Waking it for
     * each would take a sixth of the processor time of 64 pads. The first message waits for seven others, 0.2 ms. */
    FMFTS_TOGETHER = 8,
};

/* Publishes contacts. send: zmq_send of the libzmq that made `socket`. unsent: pads whose last message was not sent yet.
 * bytes: room for what is read. */
typedef struct {
    int (*send)(void *socket, const void *data, size_t size, int flags);
    void *socket;
    fmfts_pad_object *unsent[FMFTS_TOGETHER];
    int unsent_count;
    uint8_t bytes[FMFTS_ROOM];
} fmfts_bus;

typedef struct {
    PyObject *pad[FMFTS_WIRE_PADS];  
    int64_t heard_ns;                    /* 0: no frame has passed */
    unsigned left_out[FMFTS_WIRE_PADS];  /* frames that were superseded or overdue, by pad index */
    bool needs_python;                   /* Python must read `unread`; until then no frame passes */
    bool has_news;                       /* Python should learn that health or contact changed; frames go on */
    size_t unread_bytes;
    uint8_t unread[FMFTS_ROOM];          /* the beginning of a frame, or bytes for Python */
} fmfts_board_line;

/* Appends `size` bytes (at most FMFTS_READ_BYTES) to the unread ones, and handles all whole frames.
 * False and an exception if a contact could not be sent. Do not call it for a line that needs
 * Python. */
bool fmfts_pass(fmfts_board_line *line, fmfts_bus *bus, const char *more, size_t size, int64_t arrival_ns,
                fmfts_patience patience);

/* Like fmfts_pass, with all bytes that wait at the descriptor. */
bool fmfts_serve(fmfts_board_line *line, fmfts_bus *bus, int descriptor, fmfts_patience patience);

/* Sends what fmfts_pass and fmfts_serve left unsent. False and an exception if a contact could not be sent. */
bool fmfts_send_all(fmfts_bus *bus);

/* Frees the line and releases its pads. NULL: does nothing. */
void fmfts_free_line(fmfts_board_line *line);

/* Whether Python has something to do for it. */
bool fmfts_waits(const fmfts_board_line *line);

#endif
