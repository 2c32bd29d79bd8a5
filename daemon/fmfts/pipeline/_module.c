/* The module fmfts.pipeline._pad: its types, and the fields of the structs that Python fills. */
#include "_pad.h"

#include "../pose/tracking.h"

static const fmfts_field_name PARAMETERS[] = FMFTS_NAMES(FMFTS_PARAMETERS);
static const fmfts_field_name MEMORY[] = FMFTS_NAMES(FMFTS_MEMORY);
static const fmfts_field_name FOLLOWED[] = FMFTS_NAMES(FMFTS_FOLLOWED_MEMORY);
static const fmfts_field_name FOUND[] = FMFTS_NAMES(FMFTS_FRAME_FOUND);
static const fmfts_field_name MOUNTED[] = FMFTS_NAMES(FMFTS_MOUNTED_PARAMETERS);

/* Fields and inner structs have no padding: one flat NumPy record describes them. */
#define ONE_BYTES(type, name) +sizeof(type)
#define MANY_BYTES(type, name, count) +sizeof(type) * (count)
_Static_assert(sizeof(fmfts_parameters) == 0 FMFTS_PARAMETERS(ONE_BYTES, MANY_BYTES), "parameters with gaps");
_Static_assert(sizeof(fmfts_memory) == 0 FMFTS_MEMORY(ONE_BYTES, MANY_BYTES), "memory with gaps");
_Static_assert(sizeof(fmfts_followed_memory) == 0 FMFTS_FOLLOWED_MEMORY(ONE_BYTES, MANY_BYTES), "memory with gaps");
_Static_assert(sizeof(fmfts_frame_found) == 0 FMFTS_FRAME_FOUND(ONE_BYTES, MANY_BYTES), "record with gaps");
_Static_assert(sizeof(fmfts_mounted_parameters) == 0 FMFTS_MOUNTED_PARAMETERS(ONE_BYTES, MANY_BYTES), "parameters with gaps");

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
    return !loop_type || fmfts_add_fields(module, "PARAMETERS", PARAMETERS, COUNT(PARAMETERS)) < 0 ||
                   fmfts_add_fields(module, "MEMORY", MEMORY, COUNT(MEMORY)) < 0 ||
                   fmfts_add_fields(module, "FOLLOWED", FOLLOWED, COUNT(FOLLOWED)) < 0 ||
                   fmfts_add_fields(module, "FOUND", FOUND, COUNT(FOUND)) < 0 ||
                   fmfts_add_fields(module, "MOUNTED", MOUNTED, COUNT(MOUNTED)) < 0 ||
                   PyModule_AddIntConstant(module, "FELT", FMFTS_FELT) < 0 ||
                   PyModule_AddIntConstant(module, "STATE", FMFTS_STATE) < 0 ||
                   PyModule_AddIntConstant(module, "STEP", FMFTS_STEP) < 0 ||
                   PyModule_AddIntConstant(module, "TRUSTED_FRAMES", FMFTS_TRUSTED_FRAMES) < 0
               ? -1
               : 0;
}

static PyMethodDef methods[] = {
    FMFTS_METHOD(distance, "How far a change moved a magnet; see _pad.pyi."),
    FMFTS_METHOD(drawn, "A pose in the drawing's frame; see _pad.pyi."),
    FMFTS_METHOD(left_behind, "What earlier loads have left; see _pad.pyi."),
    FMFTS_METHOD(track_field, "Judge a field that is given; see _pad.pyi."),
    {NULL, NULL, 0, NULL},
};

FMFTS_MODULE(_pad, methods, set_up)
