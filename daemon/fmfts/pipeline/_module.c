/* The module fmfts.pipeline._pad: its types, and the fields of the structs that Python fills. */
#include "_pad.h"

#include "../common/_named.h"
#include "finger.h"

static const fmfts_field_name PARAMETERS[] = FMFTS_NAMES(FMFTS_PARAMETERS);
static const fmfts_field_name MEMORY[] = FMFTS_NAMES(FMFTS_MEMORY);
static const fmfts_field_name FOLLOWED[] = FMFTS_NAMES(FMFTS_FOLLOWED_MEMORY);

/* Fields and inner structs have no padding: one flat NumPy record describes them. */
#define ONE_BYTES(type, name) +sizeof(type)
#define MANY_BYTES(type, name, count) +sizeof(type) * (count)
_Static_assert(sizeof(fmfts_parameters) == 0 FMFTS_PARAMETERS(ONE_BYTES, MANY_BYTES), "parameters with gaps");
_Static_assert(sizeof(fmfts_memory) == 0 FMFTS_MEMORY(ONE_BYTES, MANY_BYTES), "memory with gaps");
_Static_assert(sizeof(fmfts_followed_memory) == 0 FMFTS_FOLLOWED_MEMORY(ONE_BYTES, MANY_BYTES), "memory with gaps");

static int add_fields(PyObject *module, const char *name, const fmfts_field_name *field, size_t count)
{
    PyObject *fields = fmfts_list_of(field, count);
    int failed = fields ? PyModule_AddObjectRef(module, name, fields) : -1;
    Py_XDECREF(fields);
    return failed;
}

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

static PyTypeObject *add_type(PyObject *module, PyType_Spec *spec)
{
    PyTypeObject *type = (PyTypeObject *)PyType_FromModuleAndSpec(module, spec, NULL);
    if (type && PyModule_AddType(module, type) < 0) {
        Py_DECREF((PyObject *)type);
        type = NULL;
    }
    return type;
}

static int set_up(PyObject *module)
{
    fmfts_pad_type = add_type(module, &fmfts_pad_spec);
    PyTypeObject *loop_type = fmfts_pad_type ? add_type(module, &fmfts_loop_spec) : NULL;
    Py_XDECREF((PyObject *)loop_type);
    return !loop_type || add_fields(module, "PARAMETERS", PARAMETERS, COUNT(PARAMETERS)) < 0 ||
                   add_fields(module, "MEMORY", MEMORY, COUNT(MEMORY)) < 0 ||
                   add_fields(module, "FOLLOWED", FOLLOWED, COUNT(FOLLOWED)) < 0 ||
                   PyModule_AddIntConstant(module, "FELT", FMFTS_FELT) < 0 ||
                   PyModule_AddIntConstant(module, "STATE", FMFTS_STATE) < 0 ||
                   PyModule_AddIntConstant(module, "STEP", FMFTS_STEP) < 0
               ? -1
               : 0;
}

static PyModuleDef_Slot slots[] = {
    {Py_mod_exec, (void *)set_up},
    {0, NULL},
};

static PyMethodDef methods[] = {
    {"distance", fmfts_distance_from_rest, METH_VARARGS, "How far a change moved a magnet; see _pad.pyi."},
    {"drawn", fmfts_drawn, METH_VARARGS, "A pose in the drawing's frame; see _pad.pyi."},
    {"follow_finger", fmfts_py_follow_finger, METH_VARARGS, "The finger as it is published; see _pad.pyi."},
    {"follow_finger_early", fmfts_py_follow_finger_early, METH_VARARGS, "The same after one sample; see _pad.pyi."},
    {"left_behind", fmfts_left_behind, METH_VARARGS, "What earlier loads have left; see _pad.pyi."},
    {"track_field", fmfts_track_field, METH_VARARGS, "Judge a field that is given; see _pad.pyi."},
    {NULL, NULL, 0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_pad", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__pad(void)
{
    return PyModuleDef_Init(&definition);
}
