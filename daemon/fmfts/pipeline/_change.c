/* Changes of pose for Python: change.c and silicone.c on given numbers, without a frame. */
#include <string.h>

#include "_pad.h"

static int is_of_a_pad(const Py_buffer *parameters, const Py_buffer *memory)
{
    if (!fmfts_has_size(parameters, sizeof(fmfts_parameters), "parameters") ||
        (memory && !fmfts_has_size(memory, sizeof(fmfts_memory), "memory"))) {
        return 0;
    }
    double leftovers = ((const fmfts_parameters *)parameters->buf)->pose.leftovers;
    if (!(leftovers >= 0.0 && leftovers <= FMFTS_LEFTOVERS)) {
        PyErr_Format(PyExc_ValueError, "a pad has from 0 to %d leftovers", FMFTS_LEFTOVERS);
        return 0;
    }
    return 1;
}

PyObject *fmfts_drawn(PyObject *module, PyObject *args)
{
    enum { PARAMETERS, STATE, COVARIANCE, POSE, SPREAD, BUFFERS };
    Py_buffer b[BUFFERS] = {{0}};
    PyObject *result = NULL;
    (void)module;
    if (PyArg_ParseTuple(args, "y*y*y*w*w*", &b[PARAMETERS], &b[STATE], &b[COVARIANCE], &b[POSE], &b[SPREAD]) &&
        is_of_a_pad(&b[PARAMETERS], NULL) && fmfts_has_size(&b[STATE], FMFTS_STATE * sizeof(double), "state") &&
        fmfts_has_size(&b[COVARIANCE], FMFTS_STEP * FMFTS_STEP * sizeof(double), "covariance") &&
        fmfts_has_size(&b[POSE], 6 * sizeof(double), "pose") && fmfts_has_size(&b[SPREAD], 36 * sizeof(double), "spread")) {
        const fmfts_pose_parameters *parameters = &((const fmfts_parameters *)b[PARAMETERS].buf)->pose;
        const fmfts_pose_memory no_loads = {0};
        fmfts_pose pose = {0};
        fmfts_displacement moved;
        memcpy(pose.covariance, b[COVARIANCE].buf, sizeof pose.covariance);
        fmfts_displace(parameters, &no_loads, b[STATE].buf, &pose, NULL, &moved);
        fmfts_draw(parameters, b[STATE].buf, &moved, 1.0, b[POSE].buf, b[SPREAD].buf);
        result = Py_NewRef(Py_None);
    }
    fmfts_give_back(b, BUFFERS);
    return result;
}

PyObject *fmfts_left_behind(PyObject *module, PyObject *args)
{
    enum { PARAMETERS, MEMORY, LEFT, BUFFERS };
    Py_buffer b[BUFFERS] = {{0}};
    double elapsed_s;
    PyObject *result = NULL;
    (void)module;
    if (PyArg_ParseTuple(args, "y*w*w*d", &b[PARAMETERS], &b[MEMORY], &b[LEFT], &elapsed_s) &&
        is_of_a_pad(&b[PARAMETERS], &b[MEMORY]) && fmfts_has_size(&b[LEFT], 25 * sizeof(double), "left")) {
        const fmfts_pose_parameters *parameters = &((const fmfts_parameters *)b[PARAMETERS].buf)->pose;
        fmfts_pose_memory *memory = &((fmfts_memory *)b[MEMORY].buf)->pose;
        const double no_change[5] = {0.0};
        memset(b[LEFT].buf, 0, (size_t)b[LEFT].len);
        fmfts_follow_creep(parameters, memory, elapsed_s);
        fmfts_creep(parameters, memory, no_change, b[LEFT].buf);
        result = Py_NewRef(Py_None);
    }
    fmfts_give_back(b, BUFFERS);
    return result;
}

PyObject *fmfts_distance_from_rest(PyObject *module, PyObject *args)
{
    Py_buffer b[2] = {{0}};
    fmfts_displacement moved;
    double moved_m, deviation_m;
    PyObject *result = NULL;
    (void)module;
    if (PyArg_ParseTuple(args, "y*y*", &b[0], &b[1]) && fmfts_has_size(&b[0], sizeof moved.change, "change") &&
        fmfts_has_size(&b[1], sizeof moved.at_rest, "covariance")) {
        memcpy(moved.change, b[0].buf, sizeof moved.change);
        memcpy(moved.at_rest, b[1].buf, sizeof moved.at_rest);
        fmfts_distance(&moved, &moved_m, &deviation_m);
        result = Py_BuildValue("(dd)", moved_m, deviation_m);
    }
    fmfts_give_back(b, 2);
    return result;
}
