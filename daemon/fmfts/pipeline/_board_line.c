/* Reads a board's line and publishes the contacts of its frames. */
#include "_board_line.h"

#include <errno.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { DONT_WAIT = 1, SEND_MORE = 2 /* zmq.h */ };

static int send(const fmfts_bus *bus, const void *part, size_t size, int flags)
{
    int sent;
    do {
        sent = bus->send(bus->socket, part, size, flags);
    } while (sent < 0 && errno == EINTR); /* Python handles the signal after this frame */
    if (sent < 0) {
        PyErr_SetFromErrno(PyExc_OSError);
    }
    return sent >= 0;
}

static int publish(const fmfts_bus *bus, const fmfts_pad_object *pad)
{
    const Py_buffer *topic = &pad->lent.topic;
    return send(bus, topic->buf, (size_t)topic->len, SEND_MORE | DONT_WAIT) &&
           send(bus, pad->message, pad->message_bytes, DONT_WAIT);
}

bool fmfts_send_all(fmfts_bus *bus)
{
    bool sent = true;
    for (int i = 0; i < bus->unsent_count; i++) {
        bus->unsent[i]->is_unsent = false;
        sent &= publish(bus, bus->unsent[i]);
    }
    bus->unsent_count = 0;
    return sent;
}

/* Notes the pad's last message as unsent, to send it together with others. */
static bool publish_later(fmfts_bus *bus, fmfts_pad_object *pad)
{
    pad->is_unsent = true;
    bus->unsent[bus->unsent_count++] = pad;
    return bus->unsent_count < FMFTS_TOGETHER || fmfts_send_all(bus);
}

/* Handles the frames in bus->bytes [0, size), as fmfts_pass does. */
static bool pass(fmfts_board_line *line, fmfts_bus *bus, size_t size, int64_t arrival_ns)
{
    size_t begin = 0;
    const uint8_t *zero;
    while ((zero = memchr(bus->bytes + begin, 0, size - begin))) {
        const uint8_t *text = bus->bytes + begin;
        size_t bytes = (size_t)(zero - text);
        /* The first two bytes of samples and early samples (firmware/wire.md) are never zero, so COBS does not change them. */
        unsigned pad_index = bytes > 2 ? text[2] & 15 : FMFTS_WIRE_PADS;
        PyObject *object = pad_index < FMFTS_WIRE_PADS ? line->pad[pad_index] : NULL;
        fmfts_pad_object *pad = object ? fmfts_lent_pad(object) : NULL;
        if ((object && !pad) || (pad && pad->is_unsent && !fmfts_send_all(bus))) {
            return false;
        }
        fmfts_handled handled = pad ? fmfts_handle_line(pad, text, bytes, arrival_ns) : FMFTS_FOR_PYTHON;
        if (handled == FMFTS_FOR_PYTHON) {
            break;
        }
        line->heard_ns = arrival_ns;
        begin += bytes + 1;
        line->left_out[pad_index] += handled == FMFTS_OVERDUE;
        if (handled == FMFTS_FAILED) {
            return false;
        }
        if (handled != FMFTS_WRITTEN) {
            continue;
        }
        line->has_news |= pad->lent.changes > 0;
        if (!publish_later(bus, pad)) {
            return false;
        }
    }
    line->unread_bytes = size - begin;
    memcpy(line->unread, bus->bytes + begin, line->unread_bytes);
    line->needs_python |= zero || line->unread_bytes > FMFTS_LONGEST_LINE;
    return true;
}

bool fmfts_pass(fmfts_board_line *line, fmfts_bus *bus, const char *more, size_t size, int64_t arrival_ns,
                fmfts_patience patience)
{
    memcpy(bus->bytes, line->unread, line->unread_bytes);
    memcpy(bus->bytes + line->unread_bytes, more, size);
    size = fmfts_keep_newest(bus->bytes, line->unread_bytes + size, patience, line->left_out);
    return pass(line, bus, size, arrival_ns);
}

/* Tells the board's clock until when all bytes have been read: bytes may still arrive between the read and this time.
 * */
static void found_empty(const fmfts_board_line *line, int64_t at_ns)
{
    for (int i = 0; i < FMFTS_WIRE_PADS; i++) {
        fmfts_pad_object *pad = line->pad[i] ? fmfts_lent_pad(line->pad[i]) : NULL;
        if (pad) {
            pad->lent.clock->empty_ns = at_ns;
        }
    }
}

bool fmfts_serve(fmfts_board_line *line, fmfts_bus *bus, int descriptor, fmfts_patience patience)
{
    size_t size = line->unread_bytes;
    ssize_t count, largest = 0;
    int64_t read_ns = 0;
    memcpy(bus->bytes, line->unread, size);
    do {
        read_ns = fmfts_now_ns(CLOCK_MONOTONIC); /* before the read: another program may delay this one after it */
        count = read(descriptor, bus->bytes + size, FMFTS_READ_BYTES);
        largest = count > largest ? count : largest;
        if (count > 0) {
            size = fmfts_keep_newest(bus->bytes, size + (size_t)count, patience, line->left_out);
        }
        /* If the rest does not shrink, Python reads it in parts. */
    } while (count > FMFTS_READ_BYTES / 2 && size <= FMFTS_ROOM - FMFTS_READ_BYTES);
    if (count == 0 || (count < 0 && errno != EAGAIN)) {
        line->needs_python = true; /* Python's read() finds the same error, and handles it */
    }
    /* Look at the clock after the read: bytes that came between the two would otherwise get too early a time. */
    int64_t arrival_ns = fmfts_now_ns(CLOCK_MONOTONIC);
    bool passed = pass(line, bus, size, arrival_ns);
    /* A short read empties the line. After a long one the kernel may not have handed over the rest yet. */
    if (passed && largest <= FMFTS_READ_BYTES / 2) {
        found_empty(line, read_ns);
    }
    return passed;
}

void fmfts_free_line(fmfts_board_line *line)
{
    for (int i = 0; line && i < FMFTS_WIRE_PADS; i++) {
        Py_XDECREF(line->pad[i]);
    }
    PyMem_Free(line);
}

bool fmfts_waits(const fmfts_board_line *line)
{
    return line->needs_python || line->has_news;
}
