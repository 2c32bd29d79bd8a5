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

FMFTS_FUNCTION(drawn)
{
    enum { PARAMETERS, STATE, COVARIANCE, POSE, SPREAD };
    const fmfts_pose_memory no_loads = {0};
    fmfts_pose pose = {0};
    fmfts_displacement moved;
    if (!PyArg_ParseTuple(args, "y*y*y*w*w*", &b[PARAMETERS], &b[STATE], &b[COVARIANCE], &b[POSE], &b[SPREAD]) ||
        !is_of_a_pad(&b[PARAMETERS], NULL) || !fmfts_has_doubles(&b[STATE], FMFTS_STATE, "state") ||
        !fmfts_has_doubles(&b[COVARIANCE], FMFTS_STEP * FMFTS_STEP, "covariance") || !fmfts_has_doubles(&b[POSE], 6, "pose") ||
        !fmfts_has_doubles(&b[SPREAD], 36, "spread")) {
        return NULL;
    }
    const fmfts_pose_parameters *parameters = &((const fmfts_parameters *)b[PARAMETERS].buf)->pose;
    memcpy(pose.covariance, b[COVARIANCE].buf, sizeof pose.covariance);
    fmfts_displace(parameters, &no_loads, b[STATE].buf, &pose, NULL, &moved);
    fmfts_draw(parameters, b[STATE].buf, &moved, 1.0, b[POSE].buf, b[SPREAD].buf);
    return Py_NewRef(Py_None);
}

FMFTS_FUNCTION(left_behind)
{
    enum { PARAMETERS, MEMORY, LEFT };
    const double no_change[5] = {0.0};
    double elapsed_s;
    if (!PyArg_ParseTuple(args, "y*w*w*d", &b[PARAMETERS], &b[MEMORY], &b[LEFT], &elapsed_s) ||
        !is_of_a_pad(&b[PARAMETERS], &b[MEMORY]) || !fmfts_has_doubles(&b[LEFT], 25, "left")) {
        return NULL;
    }
    const fmfts_pose_parameters *parameters = &((const fmfts_parameters *)b[PARAMETERS].buf)->pose;
    fmfts_pose_memory *memory = &((fmfts_memory *)b[MEMORY].buf)->pose;
    memset(b[LEFT].buf, 0, (size_t)b[LEFT].len);
    fmfts_follow_creep(parameters, memory, elapsed_s);
    fmfts_creep(parameters, memory, no_change, b[LEFT].buf);
    return Py_NewRef(Py_None);
}

FMFTS_FUNCTION(distance)
{
    fmfts_displacement moved;
    double moved_m, deviation_m;
    if (!PyArg_ParseTuple(args, "y*y*", &b[0], &b[1]) || !fmfts_has_size(&b[0], sizeof moved.change, "change") ||
        !fmfts_has_size(&b[1], sizeof moved.at_rest, "covariance")) {
        return NULL;
    }
    memcpy(moved.change, b[0].buf, sizeof moved.change);
    memcpy(moved.at_rest, b[1].buf, sizeof moved.at_rest);
    fmfts_distance(&moved, &moved_m, &deviation_m);
    return Py_BuildValue("(dd)", moved_m, deviation_m);
}
