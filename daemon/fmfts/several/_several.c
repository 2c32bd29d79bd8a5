/* fmfts.several._several: the C of this room for Python, through the stable ABI. Only the Python files of the same names call
 * it, and make the arrays. */
#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include <string.h>

#include "several.h"

enum { MOST_BUFFERS = 12 };

/* The arrays of one call: a packed model and the work space, what is read, then what is written. */
typedef struct {
    Py_buffer buffer[MOST_BUFFERS];
    int count;
    fmfts_several model;
    fmfts_several_work *work;
    size_t fingers;
} call;

enum { MODEL, WORK, FIRST };

static void release(call *c)
{
    for (int i = 0; i < c->count; i++) {
        PyBuffer_Release(&c->buffer[i]);
    }
}

/* Takes the arrays of `args`, `inputs` of them only to read. Raises and returns false where one is no array. */
static bool take(call *c, PyObject *args, int inputs, int all)
{
    c->count = 0;
    if (PyTuple_Size(args) != all) {
        PyErr_Format(PyExc_TypeError, "%zd arrays, %d expected", PyTuple_Size(args), all);
        return false;
    }
    for (; c->count < all; c->count++) {
        bool writes = c->count == WORK || c->count >= inputs;
        PyObject *one = PyTuple_GetItem(args, c->count);
        if (!one || PyObject_GetBuffer(one, &c->buffer[c->count], writes ? PyBUF_WRITABLE : PyBUF_SIMPLE) < 0) {
            release(c);
            return false;
        }
    }
    return true;
}

/* Whether array `which` has so many bytes; else raises ValueError. */
static bool has(const call *c, int which, size_t bytes)
{
    if ((size_t)c->buffer[which].len == bytes) {
        return true;
    }
    PyErr_Format(PyExc_ValueError, "array %d has %zd bytes, %zu expected", which, c->buffer[which].len, bytes);
    return false;
}

static bool has_doubles(const call *c, int which, size_t doubles)
{
    return has(c, which, doubles * sizeof(double));
}

static double *array(const call *c, int which)
{
    return c->buffer[which].buf;
}

/* The model, the work space, and fingers in array `finger`. */
static bool understood(call *c, int finger)
{
    const Py_buffer *model = &c->buffer[MODEL], *fingers = &c->buffer[finger];
    c->work = c->buffer[WORK].buf;
    c->fingers = (size_t)fingers->len / (FMFTS_FINGER * sizeof(double));
    if (!fmfts_view_several(model->buf, (size_t)model->len / sizeof(double), &c->model)) {
        PyErr_SetString(PyExc_ValueError, "the model has another size than there is room for");
        return false;
    }
    if (c->fingers > FMFTS_SEVERAL_FINGERS) {
        PyErr_Format(PyExc_ValueError, "%zu fingers, at most %d", c->fingers, FMFTS_SEVERAL_FINGERS);
        return false;
    }
    return has(c, WORK, sizeof(fmfts_several_work)) && has_doubles(c, finger, FMFTS_FINGER * c->fingers);
}

/* Copies what is predicted to arrays, or back from them: field, slope, by_pose, change, pressed, from array `first` on. */
static void exchange(const call *c, int first, bool out)
{
    const fmfts_several *m = &c->model;
    fmfts_predicted *p = &c->work->predicted[0];
    double *const inside[] = {p->field, p->slope, p->by_pose, p->change};
    const size_t count[] = {m->values, m->values * FMFTS_FINGER * c->fingers, m->values * m->poses, m->poses};
    for (int i = 0; i < 4; i++) {
        double *outside = array(c, first + i);
        memcpy(out ? outside : inside[i], out ? inside[i] : outside, count[i] * sizeof(double));
    }
    for (size_t f = 0; f < c->fingers; f++) {
        double *outside = array(c, first + 4) + f * FMFTS_PRESSED * m->poses, *own = p->pressed[f];
        memcpy(out ? outside : own, out ? own : outside, FMFTS_PRESSED * m->poses * sizeof(double));
    }
}

static bool has_predicted(const call *c, int first)
{
    const fmfts_several *m = &c->model;
    return has_doubles(c, first, m->values) && has_doubles(c, first + 1, m->values * FMFTS_FINGER * c->fingers) &&
           has_doubles(c, first + 2, m->values * m->poses) && has_doubles(c, first + 3, m->poses) &&
           has_doubles(c, first + 4, c->fingers * FMFTS_PRESSED * m->poses);
}

/* predict(model, work, fingers, field, slope, by_pose, change, pressed): False where a finger is not finite. */
static PyObject *predict(PyObject *module, PyObject *args)
{
    enum { FINGERS = FIRST, PREDICTED, ALL = PREDICTED + 5 };
    call c;
    PyObject *result = NULL;
    (void)module;
    if (!take(&c, args, PREDICTED, ALL)) {
        return NULL;
    }
    if (understood(&c, FINGERS) && has_predicted(&c, PREDICTED)) {
        bool finite = fmfts_finite(FMFTS_FINGER * c.fingers, array(&c, FINGERS));
        if (finite) {
            fmfts_predict(&c.model, c.fingers, array(&c, FINGERS), &c.work->predicted[0]);
            exchange(&c, PREDICTED, true);
        }
        result = PyBool_FromLong(finite);
    }
    release(&c);
    return result;
}

/* covariance(model, work, fingers, field, slope, by_pose, change, pressed, variance, ambient, covariance) */
static PyObject *covariance(PyObject *module, PyObject *args)
{
    enum { FINGERS = FIRST, PREDICTED, VARIANCE = PREDICTED + 5, AMBIENT, COVARIANCE, ALL };
    call c;
    PyObject *result = NULL;
    (void)module;
    if (!take(&c, args, COVARIANCE, ALL)) {
        return NULL;
    }
    size_t values;
    if (understood(&c, FINGERS) && has_predicted(&c, PREDICTED) && (values = c.model.values) &&
        has_doubles(&c, VARIANCE, values) && has_doubles(&c, AMBIENT, 3) && has_doubles(&c, COVARIANCE, values * values)) {
        exchange(&c, PREDICTED, false);
        fmfts_several_covariance(&c.model, c.fingers, array(&c, FINGERS), &c.work->predicted[0], array(&c, VARIANCE),
                                 array(&c, AMBIENT), c.work);
        memcpy(array(&c, COVARIANCE), c.work->covariance, values * values * sizeof(double));
        result = Py_NewRef(Py_None);
    }
    release(&c);
    return result;
}

static PyMethodDef methods[] = {
    {"predict", predict, METH_VARARGS, "What fingers do to the field; see field_model.py."},
    {"covariance", covariance, METH_VARARGS, "How wrong that may be; see field_model.py."},
    {NULL, NULL, 0, NULL},
};

#define FMFTS_NAMED(name, count) {#name, count},

typedef struct {
    const char *name;
    long count;
} part;

/* A dictionary from the names of a table to their counts, in order. */
static int add_layout(PyObject *module, const char *name, const part *parts, size_t count)
{
    PyObject *layout = PyDict_New();
    for (size_t i = 0; layout && i < count; i++) {
        PyObject *number = PyLong_FromLong(parts[i].count);
        if (!number || PyDict_SetItemString(layout, parts[i].name, number) < 0) {
            Py_CLEAR(layout);
        }
        Py_XDECREF(number);
    }
    int done = layout ? PyModule_AddObjectRef(module, name, layout) : -1;
    Py_XDECREF(layout);
    return done;
}

static int set_constants(PyObject *module)
{
    static const part head[] = {FMFTS_SEVERAL_HEAD(FMFTS_NAMED)};
    static const part most[] = {
        {"magnets", FMFTS_SEVERAL_MAGNETS}, {"sensors", FMFTS_SEVERAL_SENSORS}, {"fingers", FMFTS_SEVERAL_FINGERS},
        {"causes", FMFTS_SEVERAL_CAUSES},   {"terms", FMFTS_SEVERAL_TERMS},     {"places", FMFTS_SEVERAL_PLACES},
        {"starts", FMFTS_SEVERAL_STARTS},
    };
    return add_layout(module, "HEAD", head, sizeof head / sizeof *head) ||
                   add_layout(module, "MOST", most, sizeof most / sizeof *most) ||
                   PyModule_AddIntConstant(module, "WORK_BYTES", (long)sizeof(fmfts_several_work)) ||
                   PyModule_AddIntConstant(module, "LANES", FMFTS_LANES)
               ? -1
               : 0;
}

static PyModuleDef_Slot slots[] = {
    {Py_mod_exec, (void *)set_constants},
    {0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_several", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__several(void)
{
    return PyModuleDef_Init(&definition);
}
