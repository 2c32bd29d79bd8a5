/* fmfts.pipeline._pad: a pad for Python, and the loop in which pads are judged without Python. */
#ifndef FMFTS_PAD_H
#define FMFTS_PAD_H

#include "../contact/_evaluated.h" /* with Python.h first: it chooses what the system's headers declare */

#include "../sensor/wire/clock.h"
#include "fingers.h"

enum {
    FMFTS_CHANGES = 8,   /* number of changes that may wait for Python */
    FMFTS_TALLIED = 256, /* the most frames before Python must look */
    FMFTS_BOUND = 9,     /* arrays of Pad.bind */
};

/* Python's objects, held as long as the pad. */
typedef struct {
    Py_buffer parameters, memory, response, own, neighbour[FMFTS_FELT], hand, errors, bound[FMFTS_BOUND];
    fmfts_model_given model;
    PyObject *words;
    int neighbours;
} fmfts_given;

/* A pad whose samples come from a board's line without Python, since `begin`. overdue_ns: a frame that is older is left out. */
typedef struct {
    Py_buffer clock_buffer, topic;
    fmfts_clock_line *clock;
    unsigned pad_index;
    int64_t overdue_ns;
    PyObject *change[FMFTS_CHANGES]; /* messages that Python tells of: health or contact changed */
    size_t changes;
    size_t frames, early;              /* messages of frames, and of samples before their frames */
    uint32_t first_sequence, sequence; /* of the first frame and the last; without any, of the previous one */
    int64_t arrival_ns;                /* of the last frame */
    size_t latencies;
    double latency_s[FMFTS_TALLIED]; /* sample → publish, of frames with a new sample */
} fmfts_lent;

/* The part of a message from which Python makes events. health is FMFTS_HEALTHS before the first message. */
typedef struct {
    fmfts_health health;
    fmfts_contact contact;
    bool over_range, slipping;
} fmfts_gist;

/* reading, gist, times, message: of the last message. */
typedef struct {
    PyObject_HEAD
    fmfts_pad pad;
    fmfts_memory *memory;
    fmfts_reading reading;
    fmfts_told_several several; /* of the reading, where it has several magnets */
    fmfts_gist gist;
    fmfts_times times;
    uint8_t message[FMFTS_MESSAGE_ROOM];
    size_t message_bytes;
    fmfts_given given;
    fmfts_lent lent;
    /* Of several magnets: the last frame's samples at one instant, of which sensors it has one, and a new one; what `bind` gave. */
    fmfts_field aligned;
    unsigned valid, fresh;
    fmfts_bound bound;
    bool is_lent, is_unsent; /* is_unsent: the message is one of the bus's unsent ones */
} fmfts_pad_object;

extern PyType_Spec fmfts_pad_spec, fmfts_loop_spec;

/* The Python type that fmfts_pad_spec describes. */
extern PyTypeObject *fmfts_pad_type;

/* The time of CLOCK_MONOTONIC or CLOCK_REALTIME. */
int64_t fmfts_now_ns(int clock);

/* _given.c: takes the arguments of Pad(…), which _pad.pyi explains. 0 and an exception if they do not fit together. */
int fmfts_take(fmfts_pad_object *self, PyObject *args);

/* _given.c: whether objects that Python may have changed since then still fit. 0 and ValueError if not. */
int fmfts_still_fits(const fmfts_pad_object *self);

/* _given.c: the table as that of a pad with so many axes; without a buffer no cause is known. False and ValueError if it is none. */
bool fmfts_view_errors(const Py_buffer *buffer, double sensors, fmfts_field_errors *errors);

/* _given.c: releases all of it. */
void fmfts_release(fmfts_given *given);

/* False and ValueError if the buffer has another size, or is not aligned for doubles. */
static inline bool fmfts_has_size(const Py_buffer *buffer, size_t size, const char *what)
{
    return fmfts_has_bytes(buffer, size, sizeof(double), what);
}

/* _pad.c: whether differences of these fit into 64 bits. 0 and ValueError if not. */
int fmfts_are_possible(int64_t sequence, int64_t time_us, int64_t host_ns);

/* _pad.c: the health of a name in messages; FMFTS_HEALTHS, if there is none. */
fmfts_health fmfts_health_of(const char *name);

/* _pad.c: writes the reading as the next message, with `now` relative to the last frame. NULL with an exception if it has no room. */
PyObject *fmfts_written(fmfts_pad_object *self);

/* _pad.c: 0 and ValueError if the frame is not this pad's. */
int fmfts_is_of(const fmfts_pad_object *self, const fmfts_frame *frame, Py_ssize_t readings_bytes);

/* _calm.c: whether `bind` gave what the message of a frame needs; what a calm frame needs, too. False and ValueError if not. */
bool fmfts_is_bound(const fmfts_pad_object *self);
bool fmfts_is_bound_to_model(const fmfts_pad_object *self);

/* _calm.c: `now` of the last frame. from: its one finger, or one in its newest samples, or in a sample since then, of time_us; NULL:
 * nothing presses. places: the frame itself has it. False and ValueError where it is nowhere. */
bool fmfts_follow_one(fmfts_pad_object *self, bool places, const fmfts_frame_found *from, int64_t time_us);

/* _calm.c: `now` of the frame that is found, if it has one. ahead: what its newest samples show where it is untouched; NULL: nothing. */
bool fmfts_follow_found(fmfts_pad_object *self, const fmfts_frame_found *ahead);

/* _fingers.c: the message of the frame that is found, and whether it has a `now`; its health, reason and temperature are in the reading.
 * NULL with an exception. */
PyObject *fmfts_told(fmfts_pad_object *self, const fmfts_frame_found *ahead);

/* _calm.c, _fingers.c: methods of a Pad with several magnets. */
PyObject *fmfts_pad_bind(PyObject *self, PyObject *args);
PyObject *fmfts_pad_calm(PyObject *self, PyObject *args);
PyObject *fmfts_pad_align(PyObject *self, PyObject *args);
PyObject *fmfts_pad_tell(PyObject *self, PyObject *args);
PyObject *fmfts_pad_follow_early(PyObject *self, PyObject *args);

/* _pad.c: judges a frame, and writes its message. False if a number of it is not finite, or with an exception that the contact
 * model raised. */
bool fmfts_tell(fmfts_pad_object *self, const fmfts_frame *frame);

/* _pad.c: the same for a sample that came before its frame. False without an exception if it contains nothing new. */
bool fmfts_tell_early(fmfts_pad_object *self, int sensor, unsigned gain_code, const int16_t counts[3], int64_t time_us);

/* The result for a packet: Python must read it; its message is written; it is overdue and dropped; it is a sample
 * before its frame with nothing new; or there is an exception. */
typedef enum { FMFTS_FOR_PYTHON, FMFTS_WRITTEN, FMFTS_OVERDUE, FMFTS_SILENT, FMFTS_FAILED } fmfts_handled;

/* _lent.c: handles one packet of the board's line, without its closing zero. Python must read it, and nothing changes,
 * if it is neither a frame nor an early sample of this pad, or if only Python can decide. */
fmfts_handled fmfts_handle_line(fmfts_pad_object *self, const uint8_t *line, size_t size, int64_t arrival_ns);

/* _field.c: track_field(), which _pad.pyi explains. */
PyObject *fmfts_py_track_field(PyObject *module, PyObject *args);

/* _change.c: drawn(), left_behind() and distance(), which _pad.pyi explains. */
PyObject *fmfts_py_drawn(PyObject *module, PyObject *args);
PyObject *fmfts_py_left_behind(PyObject *module, PyObject *args);
PyObject *fmfts_py_distance(PyObject *module, PyObject *args);


/* _lent.c: methods of Pad, which _pad.pyi explains. */
PyObject *fmfts_pad_begin(PyObject *object, PyObject *args);
PyObject *fmfts_pad_end(PyObject *object, PyObject *unused);
PyObject *fmfts_pad_last_ns(PyObject *object, PyObject *unused);

/* _lent.c: ends the loan, whatever was handled. */
void fmfts_end(fmfts_pad_object *self);

/* _lent.c: the object as a pad. NULL and TypeError if it is another object, ValueError if it was not begun. */
fmfts_pad_object *fmfts_lent_pad(PyObject *object);

#endif
