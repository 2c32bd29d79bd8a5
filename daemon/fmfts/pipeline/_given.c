/* Checks what Python hands over of a pad, and holds it. */
#include "_pad.h"

#include <string.h>

enum { WORDS_ROOM = 2048 }; /* limit of the words in every message, so that it always has room */

/* The parts of a sighting, in the order of sighting.py. 0 and ValueError if the buffer is not of so many magnets. */
static int view_sighting(const Py_buffer *buffer, size_t magnets, fmfts_sighting *sighting)
{
    *sighting = fmfts_view_sighting(buffer->buf, magnets);
    return fmfts_has_size(buffer, FMFTS_SIGHTING(magnets) * sizeof(double), "sighting");
}

/* The parts of a hand's table, in the order of hand.py. Without a buffer the pad is on no hand that moves. */
static int view_hand(fmfts_pad_object *self)
{
    const Py_buffer *buffer = &self->given.hand;
    fmfts_hand *hand = &self->pad.hand;
    double sensors = self->pad.parameters->pose.sensors;
    if (!buffer->buf) {
        return 1;
    }
    size_t axes = sensors >= 1.0 && sensors <= FMFTS_SENSORS ? 3 * (size_t)sensors : 0;
    if (!fmfts_has_size(buffer, (2 + 6 * axes) * sizeof(double), "hand")) {
        return 0;
    }
    hand->state = buffer->buf;
    hand->time_ns = hand->state + 1;
    hand->field_t = hand->time_ns + 1;
    hand->rate_t_per_s = hand->field_t + axes;
    hand->variance_t2 = hand->rate_t_per_s + axes;
    hand->rate_variance = hand->variance_t2 + axes;
    hand->wide_field_t = hand->rate_variance + axes;
    hand->wide_variance_t2 = hand->wide_field_t + axes;
    return 1;
}

bool fmfts_view_errors(const Py_buffer *buffer, double sensors, fmfts_field_errors *errors)
{
    size_t axes = sensors >= 1.0 && sensors <= FMFTS_SENSORS ? 3 * (size_t)sensors : 1;
    size_t of_a_cause = FMFTS_CHANGE * axes * sizeof(double), causes = (size_t)buffer->len / of_a_cause;
    *errors = (fmfts_field_errors){axes, causes, buffer->buf};
    return fmfts_has_size(buffer, causes * of_a_cause, "errors");
}

/* neighbour: a tuple of its sighting's buffer and its number of magnets. felt: number of neighbouring magnets so far.
 * */
static int take_neighbour(fmfts_pad_object *self, PyObject *neighbour, size_t *felt)
{
    int i = self->given.neighbours;
    Py_ssize_t magnets;
    if (!PyTuple_Check(neighbour)) {
        PyErr_SetString(PyExc_TypeError, "a neighbour is a tuple of its sighting and its number of magnets");
        return 0;
    }
    if (!PyArg_ParseTuple(neighbour, "y*n", &self->given.neighbour[i], &magnets)) {
        return 0;
    }
    if (magnets < 1 || (size_t)magnets > FMFTS_FELT - *felt) {
        PyErr_Format(PyExc_ValueError, "neighbours have one magnet each at least, and %d together at most", FMFTS_FELT);
        return 0;
    }
    *felt += (size_t)magnets;
    self->given.neighbours++;
    return view_sighting(&self->given.neighbour[i], (size_t)magnets, &self->pad.neighbour[i]);
}

static int take_neighbours(fmfts_pad_object *self, PyObject *neighbours)
{
    size_t felt = 0;
    for (Py_ssize_t i = 0; i < PyTuple_Size(neighbours); i++) {
        if (i == FMFTS_FELT) {
            PyErr_Format(PyExc_ValueError, "%zd neighbours, %d at most", PyTuple_Size(neighbours), FMFTS_FELT);
            return 0;
        }
        if (!take_neighbour(self, PyTuple_GetItem(neighbours, i), &felt)) {
            return 0;
        }
    }
    return 1;
}

/* Printable text, even in words from elsewhere. */
static const char *or_nothing(const char *words)
{
    return words ? words : "";
}

static size_t length_of(const char *words)
{
    return strlen(or_nothing(words));
}

/* given: as Words of words.py. */
static int take_words(fmfts_words *words, PyObject *given)
{
    long long version;
    PyObject *saturated;
    if (!PyArg_ParseTuple(given, "Lzzzzzzz(O!z);words: see words.py", &version, &words->pad, &words->boot, &words->model,
                          &words->baseline, &words->no_model, &words->no_baseline, &words->lifted, &PyTuple_Type, &saturated,
                          &words->chip.untellable)) {
        return 0;
    }
    words->version = version;
    const char **spoken[] = {&words->no_model, &words->no_baseline, &words->lifted, &words->chip.untellable};
    for (size_t i = 0; i < sizeof spoken / sizeof *spoken; i++) {
        *spoken[i] = or_nothing(*spoken[i]);
    }
    for (Py_ssize_t i = 0; i < FMFTS_GAIN_CODES; i++) {
        PyObject *text = i < PyTuple_Size(saturated) ? PyTuple_GetItem(saturated, i) : NULL;
        words->chip.saturated[i] = text ? PyUnicode_AsUTF8AndSize(text, NULL) : "";
        if (!words->chip.saturated[i]) {
            return 0;
        }
    }
    if (length_of(words->pad) + length_of(words->boot) + length_of(words->model) + length_of(words->baseline) > WORDS_ROOM) {
        PyErr_Format(PyExc_ValueError, "words: the names in a message have more than %d bytes", WORDS_ROOM);
        return 0;
    }
    return 1;
}

static bool has_neighbours(const fmfts_pad_object *self)
{
    const fmfts_pose_parameters *parameters = &self->pad.parameters->pose;
    bool agrees = parameters->neighbours == self->given.neighbours;
    for (int i = 0; i < self->given.neighbours; i++) {
        agrees = agrees && parameters->neighbour_magnets[i] == (double)self->pad.neighbour[i].magnets;
    }
    return agrees;
}

int fmfts_still_fits(const fmfts_pad_object *self)
{
    const fmfts_parameters *parameters = self->pad.parameters;
    if (!self->memory) {
        PyErr_SetString(PyExc_ValueError, "this Pad failed to initialise");
    } else if (!(parameters->pose.sensors >= 1.0 && parameters->pose.sensors <= FMFTS_SENSORS)) {
        PyErr_Format(PyExc_ValueError, "parameters: a pad has 1 to %d sensors", FMFTS_SENSORS);
    } else if (!has_neighbours(self)) {
        PyErr_SetString(PyExc_ValueError, "parameters: of other neighbours than those given");
    } else if (self->pad.errors.causes && self->pad.errors.axes != 3 * (size_t)parameters->pose.sensors) {
        PyErr_SetString(PyExc_ValueError, "parameters: of other sensors than the errors given");
    } else if (parameters->message.has_model != 0.0 && self->pad.network.outputs == 0) {
        PyErr_SetString(PyExc_ValueError, "parameters: of a pad with a contact model, and none is given");
    } else {
        return 1;
    }
    return 0;
}

int fmfts_take(fmfts_pad_object *self, PyObject *args)
{
    fmfts_given *given = &self->given;
    PyObject *model, *words, *neighbours;
    if (!PyArg_ParseTuple(args, "w*w*Oz*O!w*O!|z*z*", &given->parameters, &given->memory, &model, &given->response, &PyTuple_Type,
                          &words, &given->own, &PyTuple_Type, &neighbours, &given->hand,
                          &given->errors)) {
        return 0;
    }
    given->words = Py_NewRef(words);
    self->pad.parameters = given->parameters.buf;
    self->pad.response = given->response.buf;
    self->pad.response_bytes = (size_t)given->response.len;
    if (!fmfts_has_size(&given->parameters, sizeof(fmfts_parameters), "parameters") ||
        !fmfts_has_size(&given->memory, sizeof(fmfts_memory), "memory") ||
        !fmfts_is_aligned(&given->response, sizeof(double)) || !view_sighting(&given->own, 1, &self->pad.own) ||
        !view_hand(self) || !fmfts_view_errors(&given->errors, self->pad.parameters->pose.sensors, &self->pad.errors) ||
        !take_neighbours(self, neighbours) || !take_words(&self->pad.words, words) ||
        (model != Py_None && !fmfts_take_model(model, &given->model, &self->pad.network))) {
        return 0;
    }
    self->memory = given->memory.buf;
    if (!fmfts_still_fits(self)) {
        self->memory = NULL;
        return 0;
    }
    return 1;
}

void fmfts_release(fmfts_given *given)
{
    PyBuffer_Release(&given->parameters);
    PyBuffer_Release(&given->memory);
    PyBuffer_Release(&given->response);
    PyBuffer_Release(&given->own);
    PyBuffer_Release(&given->hand);
    PyBuffer_Release(&given->errors);
    fmfts_give_back(given->bound, FMFTS_BOUND);
    for (int i = 0; i < FMFTS_FELT; i++) {
        PyBuffer_Release(&given->neighbour[i]);
    }
    fmfts_release_model(&given->model);
    Py_CLEAR(given->words);
}
