/* fmfts.contact._contact: the contact model for Python, through the stable ABI. Only inference.py, model.py,
 * touch.py and what _presses.c names call it. */
#include "_evaluated.h"

#include <math.h>

#include "../common/_named.h"
#include "../common/aligned.h"
#include "_presses.h"
#include "step.h"

/* infer(vector, pose, contact, jacobian): all float32. ValueError if their sizes do not fit each other. */
static PyObject *infer(PyObject *module, PyObject *args)
{
    Py_buffer b[4] = {{0}};
    fmfts_network network;
    PyObject *result = NULL;
    (void)module;
    if (!PyArg_ParseTuple(args, "y*y*w*w*", &b[0], &b[1], &b[2], &b[3])) {
        return NULL;
    }
    const size_t pose = FMFTS_NETWORK_POSE * sizeof(float);
    if (!fmfts_is_aligned(&b[0], sizeof(float))) {
        /* it has raised */
    } else if (!fmfts_view_network(b[0].buf, (size_t)b[0].len / sizeof(float), &network)) {
        PyErr_SetString(PyExc_ValueError, "the vector is not that of a network");
    } else if (fmfts_has_bytes(&b[1], pose, sizeof(float), "pose") &&
               fmfts_has_bytes(&b[2], network.outputs * sizeof(float), sizeof(float), "contact") &&
               fmfts_has_bytes(&b[3], network.outputs * pose, sizeof(float), "jacobian")) {
        fmfts_infer(&network, b[1].buf, b[2].buf, b[3].buf);
        result = Py_NewRef(Py_None);
    }
    fmfts_give_back(b, 4);
    return result;
}

/* The answer as Python objects; see estimate() in _contact.pyi. */
static PyObject *told(const fmfts_estimate *estimate, double *places, double *deviations)
{
    for (int i = 0; i < estimate->outputs; i++) {
        places[i] = estimate->place[i];
        deviations[i] = estimate->deviation[i];
    }
    return Py_BuildValue("(NNd)", PyBool_FromLong(estimate->over_range), PyBool_FromLong(estimate->refused),
                         estimate->force_min_n);
}

/* estimate(parameters, model, response, pose, covariance, places, deviations): as fmfts_estimate_contact, for the pose
 * moved into the range of the training. */
static PyObject *estimate(PyObject *module, PyObject *args)
{
    enum { PARAMETERS, RESPONSE, POSE, COVARIANCE, PLACES, DEVIATIONS, BUFFERS };
    Py_buffer b[BUFFERS] = {{0}};
    PyObject *model, *result = NULL;
    fmfts_model_given given = {.run = NULL};
    fmfts_network network;
    (void)module;
    if (PyArg_ParseTuple(args, "y*Oz*y*y*w*w*", &b[PARAMETERS], &model, &b[RESPONSE], &b[POSE], &b[COVARIANCE], &b[PLACES],
                         &b[DEVIATIONS]) &&
        fmfts_take_model(model, &given, &network)) {
        const size_t unit = sizeof(double), pose = FMFTS_POSE, answer = network.outputs * unit;
        if (fmfts_has_bytes(&b[PARAMETERS], sizeof(fmfts_contact_parameters), unit, "parameters") &&
            fmfts_has_bytes(&b[POSE], pose * unit, unit, "pose") &&
            fmfts_has_bytes(&b[COVARIANCE], pose * pose * unit, unit, "covariance") && fmfts_has_bytes(&b[PLACES], answer, unit, "places") &&
            fmfts_has_bytes(&b[DEVIATIONS], answer, unit, "deviations") && fmfts_is_aligned(&b[RESPONSE], unit)) {
            fmfts_question question;
            fmfts_estimate found;
            const double *from = b[POSE].buf, *spread = b[COVARIANCE].buf;
            for (size_t i = 0; i < pose * pose; i++) {
                question.covariance[i] = spread[i];
                question.pose[i % pose] = from[i % pose];
            }
            fmfts_keep_inside(b[PARAMETERS].buf, &question);
            bool is_known = fmfts_estimate_contact(b[PARAMETERS].buf, &question, &network, b[RESPONSE].buf, (size_t)b[RESPONSE].len,
                                                   &found);
            if (is_known && !PyErr_Occurred()) {
                result = told(&found, b[PLACES].buf, b[DEVIATIONS].buf);
            } else if (!PyErr_Occurred()) {
                PyErr_SetString(PyExc_ValueError, "the contact model gives no number for this pose, or its covariance is none");
            }
        }
    }
    fmfts_give_back(b, BUFFERS);
    fmfts_release_model(&given);
    return result;
}

/* touch(onset_chi2, release_chi2, touched, quiet_frames, change, covariance): both as they are after a frame. change: empty if the
 * frame has no pose. */
static PyObject *touch(PyObject *module, PyObject *args)
{
    fmfts_contact_parameters parameters = {0};
    fmfts_contact_memory memory = {0};
    Py_buffer b[2] = {{0}};
    PyObject *result = NULL;
    int touched, quiet_frames;
    (void)module;
    if (!PyArg_ParseTuple(args, "ddpiy*y*", &parameters.onset_chi2, &parameters.release_chi2, &touched, &quiet_frames, &b[0],
                          &b[1])) {
        return NULL;
    }
    const size_t unit = sizeof(double), numbers = (size_t)b[0].len / unit;
    if (quiet_frames < 0 || quiet_frames > FMFTS_RELEASE_FRAMES || numbers > FMFTS_MOST_CHANGE) {
        PyErr_Format(PyExc_ValueError, "%d quiet frames, at most %d; %zu numbers of a change, at most %d", quiet_frames,
                     FMFTS_RELEASE_FRAMES, numbers, FMFTS_MOST_CHANGE);
    } else if (fmfts_has_bytes(&b[0], numbers * unit, unit, "change") && fmfts_has_bytes(&b[1], numbers * numbers * unit, unit, "covariance")) {
        bool is_known = true;
        memory.touched = touched;
        memory.quiet_frames = quiet_frames;
        if (numbers == 0) {
            fmfts_unseen(&memory);
        } else {
            is_known = fmfts_touch(&parameters, &memory, numbers, b[0].buf, b[1].buf);
        }
        result = Py_BuildValue("(NiN)", PyBool_FromLong(memory.touched != 0.0),
                               (int)fmin(memory.quiet_frames, FMFTS_RELEASE_FRAMES), PyBool_FromLong(is_known));
    }
    fmfts_give_back(b, 2);
    return result;
}

static PyMethodDef methods[] = {
    {"touch", touch, METH_VARARGS, "Whether a pad is touched after a frame; see _contact.pyi."},
    {"estimate", estimate, METH_VARARGS, "Place and force of one pose; see _contact.pyi."},
    {"infer", infer, METH_VARARGS, "Contact and Jacobian of one pose; see _contact.pyi."},
    {"respond", fmfts_py_respond, METH_VARARGS, "The change of pose under presses, and its slope; see response.py."},
    {"basis", fmfts_py_basis, METH_VARARGS, "The factor of each coefficient of a response; see response.py."},
    {"widened", fmfts_py_widened, METH_VARARGS, "What a wider finger adds to a movement; see _contact.pyi."},
    {"pressed", fmfts_py_pressed, METH_VARARGS, "What fingers do to several magnets; see array_response.py."},
    {"refine", fmfts_py_refine, METH_VARARGS, "The press that most likely caused a change; see _contact.pyi."},
    {NULL, NULL, 0, NULL},
};

static const fmfts_field_name PARAMETER_NAMES[] = FMFTS_NAMES(FMFTS_CONTACT_PARAMETERS);

static int set_up(PyObject *module)
{
    PyObject *names = fmfts_list_of(PARAMETER_NAMES, sizeof PARAMETER_NAMES / sizeof *PARAMETER_NAMES);
    int failed = !names || PyModule_AddObjectRef(module, "PARAMETERS", names) < 0 ||
                 PyModule_AddIntConstant(module, "MAX_HIDDEN", FMFTS_MAX_HIDDEN) < 0 ||
                 PyModule_AddIntConstant(module, "RELEASE_FRAMES", FMFTS_RELEASE_FRAMES) < 0;
    Py_XDECREF(names);
    return failed ? -1 : 0;
}

static PyModuleDef_Slot slots[] = {
    {Py_mod_exec, (void *)set_up},
    {0, NULL},
};

static PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT, .m_name = "_contact", .m_size = 0, .m_methods = methods, .m_slots = slots};

PyMODINIT_FUNC PyInit__contact(void)
{
    return PyModuleDef_Init(&definition);
}
