/* fmfts.several._several: the C of this room for Python, through the stable ABI. */
#include "_arrays.h"

#include "ordinary.h"

static PyMethodDef methods[] = {
    FMFTS_METHOD(predict, "What fingers do to the field; see field_model.py."),
    FMFTS_METHOD(ahead, "The linear field of a finger that is followed; see ahead.c."),
    FMFTS_METHOD(covariance, "How wrong that may be; see field_model.py."),
    FMFTS_METHOD(poses, "Where the magnets of a frame are; see poses.py."),
    FMFTS_METHOD(free_poses, "The same by the field alone; see free_poses.py."),
    FMFTS_METHOD(fit, "The most likely fingers; see fit.py."),
    FMFTS_METHOD(whitener, "The root of a covariance; see fit.py."),
    FMFTS_METHOD(chi2_with, "Chi-square under another covariance; see fit.py."),
    FMFTS_METHOD(valley, "What a valley of chi-square leaves of deviations; see valley.py."),
    FMFTS_METHOD(best_single, "The best finger of the grid; see scan.py."),
    FMFTS_METHOD(best_pairs, "The best pairs of the grid; see scan.py."),
    FMFTS_METHOD(another, "One more finger at each place of the grid; see scan.py."),
    FMFTS_METHOD(resultant, "What several fingers press with together; see resultant.c."),
    FMFTS_METHOD(since_rest, "How the magnets' field has changed; see since_rest.py."),
    {NULL, NULL, 0, NULL},
};

typedef struct {
    const char *name;
    long count;
} part;

/* A dictionary of numbers by their names. */
static int add_numbers(PyObject *module, const char *name, const part *parts, size_t count)
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

static int add_steps(PyObject *module)
{
    static const fmfts_several_steps steps = {fmfts_view_several, fmfts_view_search, fmfts_read_ordinary, fmfts_look_ahead};
    PyObject *capsule = PyCapsule_New((void *)&steps, FMFTS_SEVERAL_STEPS, NULL);
    int done = capsule ? PyModule_AddObjectRef(module, "STEPS", capsule) : -1;
    Py_XDECREF(capsule);
    return done;
}

static int set_constants(PyObject *module)
{
    static const fmfts_field_name head[] = FMFTS_NAMES(FMFTS_SEVERAL_HEAD), search[] = FMFTS_NAMES(FMFTS_SEARCH_HEAD);
    static const part most[] = {
        {"magnets", FMFTS_SEVERAL_MAGNETS}, {"sensors", FMFTS_SEVERAL_SENSORS}, {"fingers", FMFTS_SEVERAL_FINGERS},
        {"causes", FMFTS_SEVERAL_CAUSES},   {"terms", FMFTS_SEVERAL_TERMS},     {"places", FMFTS_SEVERAL_PLACES},
        {"starts", FMFTS_SEVERAL_STARTS},
    };
    return fmfts_add_fields(module, "HEAD", head, sizeof head / sizeof *head) ||
                   fmfts_add_fields(module, "SEARCH_HEAD", search, sizeof search / sizeof *search) ||
                   add_numbers(module, "MOST", most, sizeof most / sizeof *most) ||
                   add_steps(module) || PyModule_AddIntConstant(module, "WORK_BYTES", (long)sizeof(fmfts_several_work)) ||
                   PyModule_AddIntConstant(module, "LANES", FMFTS_LANES) ||
                   PyModule_AddIntConstant(module, "PANEL", FMFTS_PANEL)
               ? -1
               : 0;
}

FMFTS_MODULE(_several, methods, set_constants)
