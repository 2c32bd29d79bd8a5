/* fmfts.several._several: the C of this room for Python, through the stable ABI. */
#include "_arrays.h"

#include "../common/_named.h"
#include "fit.h"

static PyMethodDef methods[] = {
    {"predict", fmfts_py_predict, METH_VARARGS, "What fingers do to the field; see field_model.py."},
    {"covariance", fmfts_py_covariance, METH_VARARGS, "How wrong that may be; see field_model.py."},
    {"poses", fmfts_py_poses, METH_VARARGS, "Where the magnets of a frame are; see poses.py."},
    {"free_poses", fmfts_py_free_poses, METH_VARARGS, "The same by the field alone; see free_poses.py."},
    {"fit", fmfts_py_fit, METH_VARARGS, "The most likely fingers; see fit.py."},
    {"whitener", fmfts_py_whitener, METH_VARARGS, "The root of a covariance; see fit.py."},
    {"chi2_with", fmfts_py_chi2_with, METH_VARARGS, "Chi-square under another covariance; see fit.py."},
    {"valley", fmfts_py_valley, METH_VARARGS, "Fingers of which one is put elsewhere; see valley.py."},
    {"best_single", fmfts_py_best_single, METH_VARARGS, "The best finger of the grid; see scan.py."},
    {"best_pairs", fmfts_py_best_pairs, METH_VARARGS, "The best pairs of the grid; see scan.py."},
    {"another", fmfts_py_another, METH_VARARGS, "One more finger at each place of the grid; see scan.py."},
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

static int add_fields(PyObject *module, const char *name, const fmfts_field_name *field, size_t count)
{
    PyObject *fields = fmfts_list_of(field, count);
    int done = fields ? PyModule_AddObjectRef(module, name, fields) : -1;
    Py_XDECREF(fields);
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
    return add_fields(module, "HEAD", head, sizeof head / sizeof *head) ||
                   add_fields(module, "SEARCH_HEAD", search, sizeof search / sizeof *search) ||
                   add_numbers(module, "MOST", most, sizeof most / sizeof *most) ||
                   PyModule_AddIntConstant(module, "WORK_BYTES", (long)sizeof(fmfts_several_work)) ||
                   PyModule_AddIntConstant(module, "LANES", FMFTS_LANES) ||
                   PyModule_AddIntConstant(module, "PANEL", FMFTS_PANEL)
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
