/* A frame of a pad with several magnets that the fingers of the last one explain, as most are: C judges all of it, from the aligned
 * samples to the message. Python looks closer at all others (several/estimator.py). */
#include "_pad.h"

#include <math.h>
#include <string.h>

#include "steps.h"

enum { MODEL, SEARCH, WORK, LIMITS, REST, UNTOUCHED, MOUNTED, FOLLOWED, ROOM };
_Static_assert(ROOM + 1 == FMFTS_CALM_BUFFERS, "another number of arrays");
_Static_assert((int)FMFTS_ORDINARY_FINGERS >= (int)FMFTS_TOLD_FINGERS, "limits and room for fewer fingers than are told");

static bool bind(fmfts_pad_object *self)
{
    const Py_buffer *b = self->given.calm;
    const size_t axes = 3 * (size_t)self->pad.parameters->pose.sensors, one = sizeof(double);
    fmfts_calm *calm = &self->calm;
    *calm = (fmfts_calm){.steps = PyCapsule_Import(FMFTS_SEVERAL_STEPS, 0), .work = b[WORK].buf, .limits = b[LIMITS].buf,
                         .rest = b[REST].buf, .untouched = b[UNTOUCHED].buf, .mounted = b[MOUNTED].buf, .followed = b[FOLLOWED].buf,
                         .room = b[ROOM].buf};
    if (!calm->steps || !fmfts_is_aligned(&b[MODEL], one) || !fmfts_is_aligned(&b[SEARCH], one)) {
        return false;
    }
    if (!calm->steps->view_model(b[MODEL].buf, (size_t)b[MODEL].len / one, &calm->model) || calm->model.values != axes ||
        !calm->steps->view_search(b[SEARCH].buf, (size_t)b[SEARCH].len / one, axes, &calm->search)) {
        PyErr_SetString(PyExc_ValueError, "a model, or a search, of another pad than this one");
        return false;
    }
    const size_t doubles[] = {sizeof *calm->work / one, sizeof *calm->limits / one, 5 * axes,
                              (6 + FMFTS_POSE_CHANGE) * calm->model.magnets + axes, sizeof *calm->mounted / one,
                              sizeof *calm->followed / one, sizeof *calm->room / one};
    return fmfts_have_doubles(b + WORK, doubles, FMFTS_CALM_BUFFERS - WORK);
}

PyObject *fmfts_pad_bind(PyObject *object, PyObject *args)
{
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    Py_buffer *b = self->given.calm;
    if (!fmfts_still_fits(self)) {
        return NULL;
    }
    fmfts_give_back(b, FMFTS_CALM_BUFFERS);
    self->is_bound = PyArg_ParseTuple(args, "y*y*w*y*y*y*y*w*w*", &b[MODEL], &b[SEARCH], &b[WORK], &b[LIMITS], &b[REST], &b[UNTOUCHED],
                                      &b[MOUNTED], &b[FOLLOWED], &b[ROOM]) &&
                     bind(self);
    return self->is_bound ? Py_NewRef(Py_None) : NULL;
}

static bool is_bound(const fmfts_pad_object *self)
{
    if (!fmfts_still_fits(self)) {
        return false;
    }
    if (!self->is_bound || self->calm.model.values != 3 * (size_t)self->pad.parameters->pose.sensors) {
        PyErr_SetString(PyExc_ValueError, "bind this Pad first, to the model and the rest of a pad of its size");
        return false;
    }
    return fmfts_fits_mounted(self->calm.mounted, (double)self->calm.model.magnets);
}

/* `now` of the frame, in which nothing presses, or the finger of `from`, found in a sample of time_us. places: the frame itself has
 * it. False where it is nowhere. */
static bool follow(fmfts_pad_object *self, bool places, fmfts_ahead *from, const double *covariance, int64_t time_us)
{
    fmfts_calm *calm = &self->calm;
    const fmfts_pose_memory *last = &self->memory->pose;
    const fmfts_finger_frame frame = {last->sequence, last->frame_us, self->fresh, last->field_t, last->time_us};
    const fmfts_fitter fitter = {&calm->model, &calm->search, calm->work};
    fmfts_finger_memory *finger = &calm->followed->finger;
    finger->pressing = from ? 1.0 : 0.0;
    finger->places = places;
    finger->instant_us = (double)self->aligned.instant_us;
    memcpy(finger->finger_deviation, (const double[]){0.0, 0.0, calm->mounted->quiet_force_sd_n}, sizeof finger->finger_deviation);
    if (from) {
        from->rest_t = calm->rest + 3 * calm->model.values;
        if (!fmfts_put_finger(&fitter, from, covariance, time_us, calm->steps, calm->followed)) {
            PyErr_SetString(PyExc_ValueError, "a finger that is followed is at no finite place");
            return false;
        }
    }
    fmfts_follow_finger(self->pad.parameters, calm->followed, &frame, &self->reading.now);
    return true;
}

PyObject *fmfts_pad_follow(PyObject *object, PyObject *args)
{
    enum { FINGER, COVARIANCE, CHANGE, NOISE, MISFIT, SLOPE, AMBIENT, ALL };
    fmfts_pad_object *self = (fmfts_pad_object *)object;
    Py_buffer b[ALL] = {{0}};
    long long time_us;
    double moment;
    int places;
    PyObject *found;
    bool done = false;
    if (!PyArg_ParseTuple(args, "pLdO!", &places, &time_us, &moment, &PyTuple_Type, &found) || !is_bound(self) ||
        !fmfts_are_possible(0, time_us, 0)) {
        return NULL;
    }
    const size_t values = self->calm.model.values, n = FMFTS_FINGER;
    if (!PyTuple_Size(found)) {
        done = follow(self, places, NULL, NULL, time_us);
    } else if (PyArg_ParseTuple(found, "y*y*y*y*y*y*y*", &b[FINGER], &b[COVARIANCE], &b[CHANGE], &b[NOISE], &b[MISFIT], &b[SLOPE],
                                &b[AMBIENT]) &&
               fmfts_have_doubles(b, (size_t[]){n, n * n, values, values, values, n * values, 3}, ALL)) {
        fmfts_ahead from = {.finger = b[FINGER].buf, .change_t = b[CHANGE].buf, .noise_t = b[NOISE].buf, .misfit_t = b[MISFIT].buf,
                            .slope_t = b[SLOPE].buf, .ambient_t = b[AMBIENT].buf, .moment = moment};
        done = follow(self, places, &from, b[COVARIANCE].buf, time_us);
    }
    fmfts_give_back(b, ALL);
    return done ? PyBool_FromLong(self->reading.now.known) : NULL;
}

/* Whether the newest samples of an untouched pad may show a finger that the frame's instant does not. */
static bool may_press(const fmfts_pad_object *self)
{
    const double *sure_t = self->calm.untouched + (6 + FMFTS_POSE_CHANGE) * self->calm.model.magnets;
    bool moved = false;
    for (size_t axis = 0; axis < self->calm.model.values; axis++) {
        double newer_t = fabs(self->memory->pose.field_t[axis] - self->aligned.field_t[axis]);
        moved = moved || (self->valid >> axis / 3 & 1 && newer_t > sure_t[axis]);
    }
    return moved;
}

/* `now` of a calm frame. */
static bool follow_calm(fmfts_pad_object *self, size_t fingers, double moment)
{
    const fmfts_calm_room *room = self->calm.room;
    fmfts_ahead from = {.finger = room->fingers, .change_t = room->change_t, .noise_t = room->noise_t, .misfit_t = room->misfit_t,
                        .slope_t = room->slope_t, .ambient_t = room->ambient_t, .moment = moment};
    if (fingers < 2 && !self->aligned.leap_us) {
        return follow(self, fingers, fingers ? &from : NULL, room->covariance, self->memory->pose.frame_us);
    }
    self->reading.now.known = false; /* nobody knows what presses */
    self->calm.followed->finger.pressing = -1.0;
    self->calm.followed->finger.untouched_us = self->calm.followed->motion.motion_us = 0.0;
    return true;
}

/* The message's fields. least: as in fingers.h. moved: where the magnets are under fingers. */
static void tell(fmfts_pad_object *self, const fmfts_fingers_found *found, double chi2, const fmfts_poses *moved)
{
    const fmfts_calm *calm = &self->calm;
    const size_t places = 3 * calm->model.magnets, axes = calm->model.values;
    const bool touched = found->count > 0;
    const fmfts_magnets_found magnets = {
        .position = touched ? moved->position : calm->untouched,
        .axis = touched ? moved->axis : calm->untouched + places,
        .variance = touched ? moved->variance : calm->untouched + 2 * places,
        .misfit_t = calm->room->misfit_t,
        .used = calm->room->there,
        .ambient_t = touched ? NULL : calm->room->ambient_t,
        .chi2 = chi2,
    };
    self->reading.health = FMFTS_OK;
    self->reading.sensors_ok = (1u << axes / 3) - 1;
    fmfts_clear(&self->reading.reason);
    fmfts_tell_fingers(calm->mounted, found, false, &self->several, &self->reading);
    fmfts_tell_magnets(calm->mounted, &magnets, axes, &self->several, &self->reading);
}

/* What C says of a frame that needs a closer look. */
static PyObject *not_calm(const fmfts_ordinary *found)
{
    return Py_BuildValue("(NNdi)", PyBool_FromLong(found->has_jumped), PyBool_FromLong(found->has_fit), found->fit.chi2, found->fit.flags);
}

static PyObject *judge(fmfts_pad_object *self, size_t count, const Py_buffer *b, double temperature_c)
{
    enum { PLACES, IDS, AROUND, RECENT, FACTORS };
    fmfts_calm *calm = &self->calm;
    fmfts_calm_room *room = calm->room;
    const double *factors = b[FACTORS].buf;
    double change[FMFTS_SEVERAL_POSES], position[3 * FMFTS_SEVERAL_MAGNETS], axis[3 * FMFTS_SEVERAL_MAGNETS], variance[FMFTS_SEVERAL_POSES];
    const fmfts_fitter fitter = {&calm->model, &calm->search, calm->work};
    fmfts_rest_samples samples = fmfts_samples_of(calm->model.values, calm->rest, factors);
    samples.field_t = self->aligned.field_t;
    samples.bend_t = self->aligned.bend_t;
    samples.noise_share = self->aligned.noise_share;
    samples.repeats = self->memory->pose.repeats;
    const fmfts_rest_change since = {b[RECENT].buf, room->change_t, room->variance_t2, room->there};
    const fmfts_frame_before before = {{count, b[PLACES].buf}, b[AROUND].buf};
    fmfts_ordinary found = {
        .fit = {.fingers = room->fingers, .covariance = room->covariance, .misfit_t = room->misfit_t, .ambient_t = room->ambient_t,
                .shear_n = room->shear_n, .shear_deviation_n = room->shear_deviation_n, .noise_t = room->noise_t, .slope_t = room->slope_t},
        .valley = {0, room->least},
        .poses = {change, position, axis, variance, NULL},
    };
    calm->steps->read_ordinary(&fitter, calm->limits, &before, &samples, &since, &found);
    if (!found.is_ordinary || found.has_jumped || (!count && may_press(self))) {
        return not_calm(&found);
    }
    fmfts_tell_nothing(&self->several, &self->reading);
    if (!follow_calm(self, count, factors[0])) {
        return NULL;
    }
    fmfts_fingers_found fingers = {count, {0}, room->fingers, room->covariance, room->shear_n, room->shear_deviation_n,
                                   found.valley.ways ? room->least : NULL};
    memcpy(fingers.id, b[IDS].buf, sizeof fingers.id);
    self->reading.temperature_c = temperature_c;
    tell(self, &fingers, found.fit.chi2, &found.poses);
    if (!fmfts_is_finite(&self->reading)) {
        PyErr_SetString(PyExc_ArithmeticError, "a number of the estimate is not finite: check the data of pad.contact.model");
        return NULL;
    }
    PyObject *message = fmfts_written(self);
    return message ? Py_BuildValue("(NN)", message, PyBool_FromLong(self->reading.now.known)) : NULL;
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
    if (is_bound(self)) {
        const size_t most = FMFTS_TOLD_FINGERS;
        if (count < 0 || count > (Py_ssize_t)most) {
            PyErr_Format(PyExc_ValueError, "%zd fingers, at most %zu", count, most);
        } else if (fmfts_have_doubles(b, (size_t[]){FMFTS_FINGER * most, most, 3, self->calm.model.values, 3}, ALL)) {
            result = judge(self, (size_t)count, b, temperature_c);
        }
    }
    fmfts_give_back(b, ALL);
    return result;
}
