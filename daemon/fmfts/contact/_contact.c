/* fmfts.contact._contact: the contact model for Python, through the stable ABI. Only inference.py, model.py,
 * touch.py and what _presses.c names call it. */
#include "_evaluated.h"

#include <math.h>
#include <string.h>

#include "_presses.h"
#include "step.h"

/* infer(vector, pose, contact, jacobian): all float32. ValueError if their sizes do not fit each other. */
FMFTS_FUNCTION(infer)
{
    enum { VECTOR, POSE, CONTACT, JACOBIAN };
    const size_t unit = sizeof(float), pose = FMFTS_NETWORK_POSE * unit;
    fmfts_network network;
    if (!PyArg_ParseTuple(args, "y*y*w*w*", &b[VECTOR], &b[POSE], &b[CONTACT], &b[JACOBIAN]) ||
        !fmfts_is_aligned(&b[VECTOR], unit)) {
        return NULL;
    }
    if (!fmfts_view_network(b[VECTOR].buf, (size_t)b[VECTOR].len / unit, &network)) {
        PyErr_SetString(PyExc_ValueError, "the vector is not that of a network");
        return NULL;
    }
    if (!fmfts_has_bytes(&b[POSE], pose, unit, "pose") || !fmfts_has_bytes(&b[CONTACT], network.outputs * unit, unit, "contact") ||
        !fmfts_has_bytes(&b[JACOBIAN], network.outputs * pose, unit, "jacobian")) {
        return NULL;
    }
    fmfts_infer(&network, b[POSE].buf, b[CONTACT].buf, b[JACOBIAN].buf);
    return Py_NewRef(Py_None);
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

/* The lengths of the arrays of estimate(), and of a model's parameters. */
static PyObject *estimated(const Py_buffer *b, const fmfts_network *network)
{
    enum { PARAMETERS, RESPONSE, POSE, COVARIANCE, PLACES, DEVIATIONS };
    const size_t pose = FMFTS_POSE;
    fmfts_question question;
    fmfts_estimate found;
    if (!fmfts_has_bytes(&b[PARAMETERS], sizeof(fmfts_contact_parameters), sizeof(double), "parameters")) {
        return NULL;
    }
    bool solves = ((const fmfts_contact_parameters *)b[PARAMETERS].buf)->shear_share > 0.0;
    size_t answer = solves ? FMFTS_CONTACT : network->outputs;
    if (!fmfts_has_doubles(&b[POSE], pose, "pose") || !fmfts_has_doubles(&b[COVARIANCE], pose * pose, "covariance") ||
        !fmfts_has_doubles(&b[PLACES], answer, "places") || !fmfts_has_doubles(&b[DEVIATIONS], answer, "deviations") ||
        !fmfts_is_aligned(&b[RESPONSE], sizeof(double))) {
        return NULL;
    }
    memcpy(question.pose, b[POSE].buf, sizeof question.pose);
    memcpy(question.covariance, b[COVARIANCE].buf, sizeof question.covariance);
    fmfts_keep_inside(b[PARAMETERS].buf, &question);
    bool is_known = fmfts_estimate_contact(b[PARAMETERS].buf, &question, network, b[RESPONSE].buf, (size_t)b[RESPONSE].len, &found);
    if (PyErr_Occurred()) {
        return NULL;
    }
    if (!is_known) {
        PyErr_SetString(PyExc_ValueError, "the contact model gives no number for this pose, or its covariance is none");
        return NULL;
    }
    return told(&found, b[PLACES].buf, b[DEVIATIONS].buf);
}

/* estimate(parameters, model, response, pose, covariance, places, deviations): as fmfts_estimate_contact, for the pose
 * moved into the range of the training. */
FMFTS_FUNCTION(estimate)
{
    PyObject *model, *result = NULL;
    fmfts_model_given given = {.run = NULL};
    fmfts_network network;
    if (PyArg_ParseTuple(args, "y*Oz*y*y*w*w*", &b[0], &model, &b[1], &b[2], &b[3], &b[4], &b[5]) &&
        fmfts_take_model(model, &given, &network)) {
        result = estimated(b, &network);
    }
    fmfts_release_model(&given);
    return result;
}

/* touch(onset_chi2, release_chi2, touched, quiet_frames, change, covariance): both as they are after a frame. change: empty if the
 * frame has no pose. */
FMFTS_FUNCTION(touch)
{
    enum { CHANGE, COVARIANCE, ARRAYS };
    fmfts_contact_parameters parameters = {0};
    fmfts_contact_memory memory = {0};
    int touched, quiet_frames;
    if (!PyArg_ParseTuple(args, "ddpiy*y*", &parameters.onset_chi2, &parameters.release_chi2, &touched, &quiet_frames, &b[CHANGE],
                          &b[COVARIANCE])) {
        return NULL;
    }
    const size_t numbers = (size_t)b[CHANGE].len / sizeof(double);
    if (quiet_frames < 0 || quiet_frames > FMFTS_RELEASE_FRAMES || numbers > FMFTS_MOST_CHANGE) {
        return PyErr_Format(PyExc_ValueError, "%d quiet frames, at most %d; %zu numbers of a change, at most %d", quiet_frames,
                            FMFTS_RELEASE_FRAMES, numbers, FMFTS_MOST_CHANGE);
    }
    if (!fmfts_has_doubles(&b[CHANGE], numbers, "change") || !fmfts_has_doubles(&b[COVARIANCE], numbers * numbers, "covariance")) {
        return NULL;
    }
    bool is_known = true;
    memory.touched = touched;
    memory.quiet_frames = quiet_frames;
    if (numbers == 0) {
        fmfts_unseen(&memory);
    } else {
        is_known = fmfts_touch(&parameters, &memory, numbers, b[CHANGE].buf, b[COVARIANCE].buf);
    }
    return Py_BuildValue("(NiN)", PyBool_FromLong(memory.touched != 0.0), (int)fmin(memory.quiet_frames, FMFTS_RELEASE_FRAMES),
                         PyBool_FromLong(is_known));
}

static PyMethodDef methods[] = {
    FMFTS_METHOD(touch, "Whether a pad is touched after a frame; see _contact.pyi."),
    FMFTS_METHOD(estimate, "Place and force of one pose; see _contact.pyi."),
    FMFTS_METHOD(infer, "Contact and Jacobian of one pose; see _contact.pyi."),
    FMFTS_METHOD(respond, "The change of pose under presses, and its slope; see response.py."),
    FMFTS_METHOD(basis, "The factor of each coefficient of a response; see response.py."),
    FMFTS_METHOD(widened, "What a wider finger adds to a movement; see _contact.pyi."),
    FMFTS_METHOD(pressed, "What fingers do to several magnets; see array_response.py."),
    FMFTS_METHOD(refine, "The press that most likely caused a change; see _contact.pyi."),
    {NULL, NULL, 0, NULL},
};

static const fmfts_field_name PARAMETER_NAMES[] = FMFTS_NAMES(FMFTS_CONTACT_PARAMETERS);

static int set_up(PyObject *module)
{
    return fmfts_add_fields(module, "PARAMETERS", PARAMETER_NAMES, sizeof PARAMETER_NAMES / sizeof *PARAMETER_NAMES) ||
                   PyModule_AddIntConstant(module, "MAX_HIDDEN", FMFTS_MAX_HIDDEN) ||
                   PyModule_AddIntConstant(module, "RELEASE_FRAMES", FMFTS_RELEASE_FRAMES)
               ? -1
               : 0;
}

FMFTS_MODULE(_contact, methods, set_up)
