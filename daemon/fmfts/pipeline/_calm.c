/* A frame of a pad with several magnets that the fingers of the last one explain, as most are: C judges all of it, from the aligned
 * samples to the message. Python looks closer at all others (several/estimator.py). */
#include "_pad.h"

#include <math.h>
#include <string.h>

#include "steps.h"

enum { MOUNTED, FOUND, MODEL, SEARCH, WORK, LIMITS, REST, UNTOUCHED, FOLLOWED };
_Static_assert(FOLLOWED + 1 == FMFTS_BOUND, "another number of arrays");
_Static_assert((int)FMFTS_ORDINARY_FINGERS >= (int)FMFTS_TOLD_FINGERS, "limits and room for fewer fingers than are told");

/* Whether such parameters have room. False and ValueError if not. */
static bool have_room(const fmfts_mounted_parameters *mounted)
{
    if (!(mounted->magnets >= 0.0 && mounted->magnets <= FMFTS_TOLD_MAGNETS && mounted->causes >= 0.0 &&
          mounted->causes <= FMFTS_TOLD_CAUSES)) {
        PyErr_SetString(PyExc_ValueError, "parameters of more magnets, or of more causes of errors, than there is room for");
        return false;
    }
    return true;
}

static bool bind_to_model(fmfts_pad_object *self)
{
    const Py_buffer *b = self->given.bound;
    const size_t axes = 3 * (size_t)self->pad.parameters->pose.sensors, one = sizeof(double);
    fmfts_bound *bound = &self->bound;
    bound->steps = PyCapsule_Import(FMFTS_SEVERAL_STEPS, 0);
    bound->work = b[WORK].buf;
    bound->limits = b[LIMITS].buf;
    bound->rest = b[REST].buf;
    bound->untouched = b[UNTOUCHED].buf;
    bound->followed = b[FOLLOWED].buf;
    if (!bound->steps || !fmfts_is_aligned(&b[MODEL], one) || !fmfts_is_aligned(&b[SEARCH], one)) {
        return false;
    }
    if (!bound->steps->view_model(b[MODEL].buf, (size_t)b[MODEL].len / one, &bound->model) || bound->model.values != axes ||
        !bound->steps->view_search(b[SEARCH].buf, (size_t)b[SEARCH].len / one, axes, &bound->search)) {
        PyErr_SetString(PyExc_ValueError, "a model, or a search, of another pad than this one");
        return false;
    }
    const size_t doubles[] = {sizeof *bound->work / one, sizeof *bound->limits / one, 5 * axes,
                              (6 + FMFTS_POSE_CHANGE) * bound->model.magnets + axes, sizeof *bound->followed / one};
    return fmfts_have_doubles(b + WORK, doubles, FMFTS_BOUND - WORK);
}

PyObject *fmfts_pad_bind(PyObject *object, PyObject *args)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    Py_buffer *b = self->given.bound;
    PyObject *calm;
    if (!fmfts_still_fits(self)) {
        return NULL;
    }
    fmfts_give_back(b, FMFTS_BOUND);
    self->bound = (fmfts_bound){0};
    const size_t doubles[] = {sizeof *self->bound.mounted / sizeof(double), sizeof *self->bound.found / sizeof(double)};
    if (!PyArg_ParseTuple(args, "y*w*O!", &b[MOUNTED], &b[FOUND], &PyTuple_Type, &calm) || !fmfts_have_doubles(b, doubles, 2) ||
        !have_room(b[MOUNTED].buf)) {
        return NULL;
    }
    if (PyTuple_Size(calm) && !(PyArg_ParseTuple(calm, "y*y*w*y*y*y*w*", &b[MODEL], &b[SEARCH], &b[WORK], &b[LIMITS], &b[REST],
                                                 &b[UNTOUCHED], &b[FOLLOWED]) &&
                                bind_to_model(self))) {
        self->bound = (fmfts_bound){0};
        return NULL;
    }
    self->bound.mounted = b[MOUNTED].buf;
    self->bound.found = b[FOUND].buf;
    return Py_NewRef(Py_None);
}

bool fmfts_is_bound(const fmfts_pad_object *self)
{
    const fmfts_bound *bound = &self->bound;
    if (!fmfts_still_fits(self)) {
        return false;
    }
    if (!bound->found || (bound->steps && (bound->model.values != 3 * (size_t)self->pad.parameters->pose.sensors ||
                                           (double)bound->model.magnets != bound->mounted->magnets))) {
        PyErr_SetString(PyExc_ValueError, "bind this Pad first, to the model and the rest of a pad of its size");
        return false;
    }
    if (bound->found->count < 0 || bound->found->count > FMFTS_TOLD_FINGERS) {
        PyErr_Format(PyExc_ValueError, "%lld fingers, at most %d", (long long)bound->found->count, FMFTS_TOLD_FINGERS);
        return false;
    }
    return have_room(bound->mounted);
}

bool fmfts_is_bound_to_model(const fmfts_pad_object *self)
{
    if (!self->bound.steps) {
        PyErr_SetString(PyExc_ValueError, "bind this Pad to a model first");
        return false;
    }
    return fmfts_is_bound(self);
}

bool fmfts_follow_one(fmfts_pad_object *self, bool places, const fmfts_frame_found *from, int64_t time_us)
{
    fmfts_bound *bound = &self->bound;
    const fmfts_pose_memory *last = &self->memory->pose;
    const fmfts_finger_frame frame = {last->sequence, last->frame_us, self->fresh, last->field_t, last->time_us};
    const fmfts_fitter fitter = {&bound->model, &bound->search, bound->work};
    fmfts_finger_memory *finger = &bound->followed->finger;
    finger->pressing = from ? 1.0 : 0.0;
    finger->places = places;
    finger->instant_us = (double)self->aligned.instant_us;
    memcpy(finger->finger_deviation, (const double[]){0.0, 0.0, bound->mounted->quiet_force_sd_n}, sizeof finger->finger_deviation);
    if (from) {
        fmfts_ahead ahead = {.finger = from->fingers, .change_t = from->change_t, .noise_t = from->noise_t,
                             .misfit_t = from->misfit_t, .slope_t = from->slope_t, .ambient_t = from->ambient_t,
                             .rest_t = bound->rest + 3 * bound->model.values, .moment = from->moment};
        if (!fmfts_put_finger(&fitter, &ahead, from->covariance, time_us, bound->steps, bound->followed)) {
            PyErr_SetString(PyExc_ValueError, "a finger that is followed is at no finite place");
            return false;
        }
    }
    fmfts_follow_finger(self->pad.parameters, bound->followed, &frame, &self->reading.now);
    return true;
}

bool fmfts_follow_found(fmfts_pad_object *self, const fmfts_frame_found *ahead)
{
    const fmfts_frame_found *found = self->bound.found;
    fmfts_followed_memory *followed = self->bound.followed;
    bool is_known = self->reading.health == FMFTS_OK && found->has_fingers && !found->over_range && found->count < 2;
    self->reading.now.known = false;
    if (!followed) {
        return true;
    }
    if (is_known && !self->aligned.leap_us) {
        return fmfts_follow_one(self, found->count, found->count ? found : ahead, self->memory->pose.frame_us);
    }
    followed->finger.pressing = -1.0; /* nobody knows what presses */
    followed->finger.untouched_us = followed->motion.motion_us = 0.0;
    return true;
}

/* Whether the newest samples of an untouched pad may show a finger that the frame's instant does not. */
static bool may_press(const fmfts_pad_object *self)
{
    const double *sure_t = self->bound.untouched + (6 + FMFTS_POSE_CHANGE) * self->bound.model.magnets;
    bool moved = false;
    for (size_t axis = 0; axis < self->bound.model.values; axis++) {
        double newer_t = fabs(self->memory->pose.field_t[axis] - self->aligned.field_t[axis]);
        moved = moved || (self->valid >> axis / 3 & 1 && newer_t > sure_t[axis]);
    }
    return moved;
}

/* What C says of a frame that needs a closer look. */
static PyObject *not_calm(const fmfts_ordinary *found)
{
    return Py_BuildValue("(NNdi)", PyBool_FromLong(found->has_jumped), PyBool_FromLong(found->has_fit), found->fit.chi2, found->fit.flags);
}

static PyObject *judge(fmfts_pad_object *self, size_t count, const Py_buffer *b, double temperature_c)
{
    enum { PLACES, IDS, AROUND, RECENT, FACTORS };
    fmfts_bound *bound = &self->bound;
    fmfts_frame_found *frame = bound->found;
    const size_t places = 3 * bound->model.magnets;
    const double *factors = b[FACTORS].buf, *untouched = bound->untouched;
    double change[FMFTS_SEVERAL_POSES];
    const fmfts_fitter fitter = {&bound->model, &bound->search, bound->work};
    fmfts_rest_samples samples = fmfts_samples_of(bound->model.values, bound->rest, factors);
    samples.field_t = self->aligned.field_t;
    samples.bend_t = self->aligned.bend_t;
    samples.noise_share = self->aligned.noise_share;
    samples.repeats = self->memory->pose.repeats;
    const fmfts_rest_change since = {b[RECENT].buf, frame->change_t, frame->variance_t2, frame->used};
    const fmfts_frame_before before = {{count, b[PLACES].buf}, b[AROUND].buf};
    fmfts_ordinary found = {
        .fit = {.fingers = frame->fingers, .covariance = frame->covariance, .misfit_t = frame->misfit_t, .ambient_t = frame->ambient_t,
                .shear_n = frame->shear_n, .shear_deviation_n = frame->shear_deviation_n, .noise_t = frame->noise_t,
                .slope_t = frame->slope_t},
        .valley = {0, frame->least},
        .poses = {change, frame->position, frame->axis, frame->variance, NULL},
    };
    bound->steps->read_ordinary(&fitter, bound->limits, &before, &samples, &since, &found);
    if (!found.is_ordinary || found.has_jumped || (!count && may_press(self))) {
        return not_calm(&found);
    }
    if (!count) {
        memcpy(frame->position, untouched, places * sizeof(double));
        memcpy(frame->axis, untouched + places, places * sizeof(double));
        memcpy(frame->variance, untouched + 2 * places, FMFTS_POSE_CHANGE * bound->model.magnets * sizeof(double));
    }
    memcpy(frame->id, b[IDS].buf, sizeof frame->id);
    frame->has_fingers = frame->has_magnets = true;
    frame->has_least = found.valley.ways > 0;
    frame->more = frame->over_range = false;
    frame->count = (int64_t)count;
    frame->chi2 = found.fit.chi2;
    frame->moment = factors[0];
    frame->displacement_m = NAN;
    self->reading.health = FMFTS_OK;
    self->reading.temperature_c = temperature_c;
    fmfts_clear(&self->reading.reason);
    return fmfts_told(self, NULL);
}

PyObject *fmfts_pad_calm(PyObject *object, PyObject *args)
{
    enum { PLACES, IDS, AROUND, RECENT, FACTORS, ALL };
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    Py_buffer b[ALL] = {{0}};
    Py_ssize_t count;
    double temperature_c;
    PyObject *result = NULL;
    if (!PyArg_ParseTuple(args, "ny*y*y*w*y*d", &count, &b[PLACES], &b[IDS], &b[AROUND], &b[RECENT], &b[FACTORS], &temperature_c)) {
        return NULL;
    }
    if (fmfts_is_bound_to_model(self)) {
        const size_t most = FMFTS_TOLD_FINGERS;
        if (count < 0 || count > (Py_ssize_t)most) {
            PyErr_Format(PyExc_ValueError, "%zd fingers, at most %zu", count, most);
        } else if (fmfts_have_doubles(b, (size_t[]){FMFTS_FINGER * most, most, 3, self->bound.model.values, 3}, ALL)) {
            result = judge(self, (size_t)count, b, temperature_c);
        }
    }
    fmfts_give_back(b, ALL);
    return result;
}
