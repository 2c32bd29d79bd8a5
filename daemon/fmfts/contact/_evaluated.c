#include "_evaluated.h"

#include <math.h>
#include <string.h>

static void fill_with_nan(const Py_buffer *buffer, float *numbers)
{
    for (size_t i = 0; i < (size_t)buffer->len / sizeof(float); i++) {
        numbers[i] = NAN;
    }
}

/* Asks the object. Once it has raised, it is not asked again. */
static void evaluate(void *context, const float *pose, float *contact, float *jacobian)
{
    fmfts_model_given *given = context;
    PyObject *done = NULL;
    if (!PyErr_Occurred()) {
        memcpy(given->pose.buf, pose, (size_t)given->pose.len);
        done = PyObject_CallNoArgs(given->run);
    }
    if (done) {
        memcpy(contact, given->contact.buf, (size_t)given->contact.len);
        memcpy(jacobian, given->jacobian.buf, (size_t)given->jacobian.len);
        Py_DECREF(done);
    } else {
        fill_with_nan(&given->contact, contact);
        fill_with_nan(&given->jacobian, jacobian);
    }
}

static int view_part(PyObject *model, const char *name, Py_buffer *part)
{
    PyObject *array = PyObject_GetAttrString(model, name);
    int failed = !array || PyObject_GetBuffer(array, part, PyBUF_WRITABLE) < 0;
    Py_XDECREF(array);
    return !failed && fmfts_is_aligned(part, sizeof(float));
}

static int take_object(PyObject *model, fmfts_model_given *given, fmfts_network *network)
{
    const size_t row = FMFTS_NETWORK_POSE * sizeof(float);
    given->run = PyObject_GetAttrString(model, "run");
    if (!given->run || !view_part(model, "pose", &given->pose) || !view_part(model, "contact", &given->contact) ||
        !view_part(model, "jacobian", &given->jacobian)) {
        return 0;
    }
    size_t outputs = (size_t)given->contact.len / sizeof(float);
    if ((size_t)given->pose.len != row || (size_t)given->contact.len != outputs * sizeof(float) ||
        (size_t)given->jacobian.len != outputs * row) {
        PyErr_SetString(PyExc_ValueError, "network: pose, contact and jacobian are not float32 of one model");
        return 0;
    }
    *network = (fmfts_network){.evaluate = evaluate, .context = given, .outputs = outputs};
    return 1;
}

int fmfts_take_model(PyObject *model, fmfts_model_given *given, fmfts_network *network)
{
    if (!PyObject_CheckBuffer(model)) {
        if (!take_object(model, given, network)) {
            return 0;
        }
    } else if (PyObject_GetBuffer(model, &given->vector, PyBUF_SIMPLE) < 0 || !fmfts_is_aligned(&given->vector, sizeof(float))) {
        return 0;
    } else if (!fmfts_view_network(given->vector.buf, (size_t)given->vector.len / sizeof(float), network)) {
        network->outputs = 0;
    }
    if (network->outputs != 3 && network->outputs != FMFTS_MAX_OUTPUTS) {
        PyErr_SetString(PyExc_ValueError, "network: not a network with three or five outputs");
        return 0;
    }
    return 1;
}

void fmfts_release_model(fmfts_model_given *given)
{
    PyBuffer_Release(&given->vector);
    PyBuffer_Release(&given->pose);
    PyBuffer_Release(&given->contact);
    PyBuffer_Release(&given->jacobian);
    Py_CLEAR(given->run);
}
