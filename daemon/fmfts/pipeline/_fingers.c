/* Messages of a pad with several magnets: methods of Pad for several_pipeline.py, which judges the frames. */
#include "_pad.h"

#include <math.h>
#include <string.h>

#include "../pose/push.h"
#include "steps.h"

PyObject *fmfts_told(fmfts_pad_object *self, const fmfts_frame_found *ahead)
{
    const fmfts_bound *bound = &self->bound;
    fmfts_reading *reading = &self->reading;
    if (!fmfts_follow_found(self, ahead)) {
        return NULL;
    }
    fmfts_tell_found(bound->mounted, bound->found, (size_t)self->pad.parameters->pose.sensors, &self->several, reading);
    if (!fmfts_is_finite(reading)) {
        PyErr_SetString(PyExc_ArithmeticError, "a number of the estimate is not finite: check the data of pad.contact.model");
        return NULL;
    }
    PyObject *message = fmfts_written(self);
    return message ? Py_BuildValue("(NN)", message, PyBool_FromLong(reading->now.known)) : NULL;
}

/* What is found in the newest samples. NULL if it is None; without an exception, or with one if it is none. */
static const fmfts_frame_found *found_ahead(PyObject *object, Py_buffer *buffer)
{
    if (object == Py_None || PyObject_GetBuffer(object, buffer, PyBUF_SIMPLE) < 0 ||
        !fmfts_has_size(buffer, sizeof(fmfts_frame_found), "what is found ahead")) {
        return NULL;
    }
    return buffer->buf;
}

PyObject *fmfts_pad_tell(PyObject *object, PyObject *args)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    fmfts_reading *reading = &self->reading;
    const char *health, *reason;
    double temperature_c;
    PyObject *newest, *result = NULL;
    Py_buffer buffer = {0};
    if (!PyArg_ParseTuple(args, "ssdO", &health, &reason, &temperature_c, &newest) || !fmfts_is_bound(self)) {
        return NULL;
    }
    if ((reading->health = fmfts_health_of(health)) == FMFTS_HEALTHS) {
        return PyErr_Format(PyExc_ValueError, "there is no health '%s'", health);
    }
    reading->temperature_c = temperature_c;
    fmfts_clear(&reading->reason);
    fmfts_say(&reading->reason, "%s", reason);
    const fmfts_frame_found *ahead = found_ahead(newest, &buffer);
    if (!PyErr_Occurred()) {
        result = fmfts_told(self, ahead);
    }
    PyBuffer_Release(&buffer);
    return result;
}

/* The newest samples of the frame; NaN for a sensor without one. */
static void list_newest(const fmfts_pad_object *self, unsigned valid, double *newest_t)
{
    for (size_t axis = 0; axis < 3 * (size_t)self->pad.parameters->pose.sensors; axis++) {
        newest_t[axis] = valid >> axis / 3 & 1 ? self->memory->pose.field_t[axis] : NAN;
    }
}

static bool is_whole(const fmfts_step *step, size_t axes)
{
    bool whole = true;
    for (size_t axis = 0; axis < axes; axis++) {
        whole = whole && isfinite(step->field.field_t[axis]) && !(step->missing.stuck[axis / 3] >> axis % 3 & 1);
    }
    return whole;
}

PyObject *fmfts_pad_align(PyObject *object, PyObject *args)
{
    enum { READINGS, FIELD, SHARE, BEND, REPEATS, NEWEST, ALL };
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    fmfts_frame frame;
    long long sequence, time_us, host_ns;
    Py_buffer b[ALL] = {{0}};
    PyObject *result = NULL;
    if (!PyArg_ParseTuple(args, "IIIy*LLLdw*w*w*w*w*", &frame.gain_code, &frame.valid, &frame.fresh, &b[READINGS], &sequence,
                          &time_us, &host_ns, &frame.temperature_c, &b[FIELD], &b[SHARE], &b[BEND], &b[REPEATS], &b[NEWEST])) {
        return NULL;
    }
    frame.readings = b[READINGS].buf;
    frame.sequence = sequence;
    frame.time_us = time_us;
    frame.host_ns = host_ns;
    if (fmfts_still_fits(self) && fmfts_is_of(self, &frame, b[READINGS].len)) {
        const size_t axes = 3 * (size_t)self->pad.parameters->pose.sensors, bytes = axes * sizeof(double);
        fmfts_frame_work work;
        const fmfts_field *field = &work.step.field;
        if (fmfts_have_doubles(b + FIELD, (size_t[]){axes, axes / 3, axes, axes, axes}, ALL - FIELD)) {
            fmfts_begin(&self->pad, self->memory, &frame, &work, &self->reading);
            fmfts_align(&work.step, &frame);
            fmfts_date(&frame, &work);
            self->reading.missing = work.step.missing;
            self->aligned = *field;
            self->valid = frame.valid;
            self->fresh = frame.fresh & frame.valid;
            memcpy(b[FIELD].buf, field->field_t, bytes);
            memcpy(b[SHARE].buf, field->noise_share, bytes / 3);
            memcpy(b[BEND].buf, field->bend_t, bytes);
            memcpy(b[REPEATS].buf, self->memory->pose.repeats, bytes);
            list_newest(self, frame.valid, b[NEWEST].buf);
            result = Py_BuildValue("(LNNLN)", (long long)field->instant_us, PyBool_FromLong(field->is_old),
                                   PyBool_FromLong(field->began_anew), (long long)field->leap_us,
                                   PyBool_FromLong(is_whole(&work.step, axes)));
        }
    }
    fmfts_give_back(b, ALL);
    return result;
}

/* Whether a sample is new, and certainly another than that sensor's in the last frame, but no farther than a finger changes it. */
static bool has_changed(const fmfts_pad_object *self, const fmfts_early *early)
{
    const double sure = 5.7; /* four deviations of a difference of two samples */
    const fmfts_pose_parameters *parameters = &self->pad.parameters->pose;
    const fmfts_pose_memory *last = &self->memory->pose;
    bool is_new = self->pad.parameters->now.early_lead_us > 0.0 && fmfts_is_new(parameters, last->time_us, early), changed = false;
    for (int axis = 3 * early->sensor, k = 0; is_new && k < 3; k++) {
        double noise_t = parameters->noise_t[axis + k] * fabs(parameters->gain[axis + k]);
        double change_t = fabs(early->field_t[k] - last->field_t[axis + k]);
        changed = changed || change_t > sure * noise_t;
        is_new = change_t < FMFTS_JUMP_T;
    }
    return changed && is_new;
}

/* The message of a sample, with another `now`; None: it has no news; True: nothing pressed so far, and now a finger may. */
static PyObject *told_early(fmfts_pad_object *self, const fmfts_early *early, const fmfts_frame_found *ahead)
{
    fmfts_followed_memory *followed = self->bound.followed;
    fmfts_now *now = &self->reading.now;
    if (ahead && !fmfts_follow_one(self, false, ahead, early->time_us)) {
        return NULL;
    }
    if (!self->reading.several || (ahead && !now->known)) {
        return Py_NewRef(Py_None);
    }
    if (followed->finger.pressing == 0.0 && has_changed(self, early)) {
        return Py_NewRef(Py_True);
    }
    fmfts_follow_finger_early(self->pad.parameters, followed, early, now);
    return now->known ? fmfts_written(self) : Py_NewRef(Py_None);
}

PyObject *fmfts_pad_follow_early(PyObject *object, PyObject *args)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    long long time_us;
    int sensor;
    unsigned int gain_code;
    int16_t counts[3];
    PyObject *newest, *result = NULL;
    Py_buffer buffer = {0};
    if (!PyArg_ParseTuple(args, "iIhhhLO", &sensor, &gain_code, &counts[0], &counts[1], &counts[2], &time_us, &newest) ||
        !fmfts_is_bound_to_model(self) || !fmfts_are_possible(0, time_us, 0)) {
        return NULL;
    }
    fmfts_early early = {.sensor = sensor, .time_us = time_us};
    fmfts_read_early(&self->pad.parameters->pose, gain_code, counts, early.field_t);
    const fmfts_frame_found *ahead = found_ahead(newest, &buffer);
    if (!PyErr_Occurred()) {
        result = told_early(self, &early, ahead);
    }
    PyBuffer_Release(&buffer);
    return result;
}
