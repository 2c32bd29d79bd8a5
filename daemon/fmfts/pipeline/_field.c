/* The tracker of frame.c on a given field, without counts, baseline and contact: for studies that compare it with other
 * methods. */
#include <math.h>
#include <string.h>

#include "_pad.h"
#include "steps.h"

enum { PARAMETERS, MEMORY, FIELD, DEVIATION, LASTING, COVARIANCE, ERRORS };

static int sizes_agree(const Py_buffer *b)
{
    const fmfts_parameters *parameters = b[PARAMETERS].buf;
    if (!fmfts_has_size(&b[PARAMETERS], sizeof(fmfts_parameters), "parameters") ||
        !fmfts_has_size(&b[MEMORY], sizeof(fmfts_memory), "memory")) {
        return 0;
    }
    if (!(parameters->pose.sensors >= 1.0 && parameters->pose.sensors <= FMFTS_SENSORS)) {
        PyErr_Format(PyExc_ValueError, "parameters: a pad has 1 to %d sensors", FMFTS_SENSORS);
        return 0;
    }
    const size_t axes = 3 * (size_t)parameters->pose.sensors * sizeof(double);
    return fmfts_has_size(&b[FIELD], axes, "field") && fmfts_has_size(&b[DEVIATION], axes, "deviation") &&
           fmfts_has_size(&b[LASTING], axes, "lasting") &&
           fmfts_has_size(&b[COVARIANCE], FMFTS_STEP * FMFTS_STEP * sizeof(double), "covariance");
}

static void take_field(fmfts_step *step, const Py_buffer *b)
{
    const double *field_t = b[FIELD].buf, *deviation_t = b[DEVIATION].buf, *lasting_t = b[LASTING].buf;
    fmfts_field *field = &step->field;
    memset(&step->missing, 0, sizeof step->missing);
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        field->field_t[axis] = field_t[axis];
        field->variance_t2[axis] = deviation_t[axis] * deviation_t[axis];
        field->other_t2[axis] = lasting_t[axis] * lasting_t[axis];
        field->unknown_t2[axis] = field->bend_t[axis] = 0.0;
    }
}

FMFTS_FUNCTION(track_field)
{
    double elapsed_s, temperature_c;
    fmfts_frame_work work;
    fmfts_field_errors errors;
    if (!PyArg_ParseTuple(args, "y*w*y*y*y*w*ddz*", &b[PARAMETERS], &b[MEMORY], &b[FIELD], &b[DEVIATION], &b[LASTING], &b[COVARIANCE],
                          &elapsed_s, &temperature_c, &b[ERRORS]) ||
        !sizes_agree(b) ||
        !fmfts_view_errors(&b[ERRORS], ((const fmfts_parameters *)b[PARAMETERS].buf)->pose.sensors, &errors)) {
        return NULL;
    }
    fmfts_step *step = &work.step;
    fmfts_begin_step(b[PARAMETERS].buf, b[MEMORY].buf, temperature_c, &work);
    take_field(step, b);
    step->errors = errors;
    step->field.elapsed_s = elapsed_s;
    fmfts_track(step);
    fmfts_watch_residuals(step);
    fmfts_doubt_beside_steel(step);
    fmfts_watch_ambient(step);
    fmfts_follow_foreign(step);
    bool has_estimate = step->verdict.has_estimate;
    if (has_estimate) {
        memcpy(b[COVARIANCE].buf, step->pose.covariance, sizeof step->pose.covariance);
    }
    return Py_BuildValue("(ssINdd)", fmfts_health_name(step->verdict.health), step->verdict.reason.text, fmfts_sensors_used(step),
                         PyBool_FromLong(has_estimate), has_estimate ? step->pose.chi2 : NAN,
                         has_estimate ? step->pose.residual_t : NAN);
}
