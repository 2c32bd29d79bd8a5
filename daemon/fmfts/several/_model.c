/* Prediction and covariance for Python: field_model.py calls them, and makes the arrays. */
#include "_arrays.h"
#include "resultant.h"

#include <string.h>

/* Copies a prediction to arrays, or back from them: field, slope, by_pose, change, pressed, from array `first` on. */
static void exchange(const call *c, fmfts_predicted *p, int first, bool out)
{
    const fmfts_several *m = &c->model;
    double *const inside[] = {p->field, p->slope, p->by_pose, p->change};
    const size_t count[] = {m->values, m->values * FMFTS_FINGER * c->fingers, m->values * m->poses, m->poses};
    for (int i = 0; i < 4; i++) {
        double *outside = array(c, first + i);
        memcpy(out ? outside : inside[i], out ? inside[i] : outside, count[i] * sizeof(double));
    }
    for (size_t f = 0; f < c->fingers; f++) {
        double *outside = array(c, first + 4) + f * FMFTS_PRESSED * m->poses, *own = p->pressed[f];
        memcpy(out ? outside : own, out ? own : outside, FMFTS_PRESSED * m->poses * sizeof(double));
    }
}

static bool has_predicted(const call *c, int first)
{
    const size_t values = c->model.values, poses = c->model.poses, each = FMFTS_PRESSED * poses;
    const size_t wanted[] = {values, values * FMFTS_FINGER * c->fingers, values * poses, poses, c->fingers * each};
    return have_doubles(c, first, wanted, 5);
}

/* predict(model, work, fingers, field, slope, by_pose, change, pressed): False where a finger is not finite. */
FMFTS_FUNCTION(predict)
{
    enum { FINGERS = FIRST, PREDICTED, ALL = PREDICTED + 5 };
    call c = {.buffer = b};
    if (!take(&c, args, PREDICTED, ALL) || !understood(&c, FINGERS) || !has_predicted(&c, PREDICTED)) {
        return NULL;
    }
    bool finite = fmfts_finite(FMFTS_FINGER * c.fingers, array(&c, FINGERS));
    if (finite) {
        int own = fmfts_predict_in(&c.model, fingers(&c, FINGERS), c.work);
        exchange(&c, &c.work->predicted[own], PREDICTED, true);
    }
    return PyBool_FromLong(finite);
}

/* For tests, as pipeline/_calm.c calls it without Python.
 *
 * ahead(model, work, finger, change, noise, misfit, slope, ambient, rest, there, numbers, ahead, by_finger): there: the same array as
 * finger where it has not moved; numbers: moment and light_n. */
FMFTS_FUNCTION(ahead)
{
    enum { FINGER = FIRST, CHANGE, NOISE, MISFIT, SLOPE, AMBIENT, REST, THERE, NUMBERS, AHEAD, BY_FINGER, ALL };
    call c = {.buffer = b};
    if (!take(&c, args, AHEAD, ALL) || !has_model(&c)) {
        return NULL;
    }
    const size_t values = c.model.values, slopes = FMFTS_FINGER * values;
    const size_t wanted[] = {FMFTS_FINGER, values, values, values, slopes, 3, values, FMFTS_FINGER, 2, values, slopes};
    if (!have_doubles(&c, FINGER, wanted, ALL - FINGER)) {
        return NULL;
    }
    const fmfts_ahead from = {
        .finger = array(&c, FINGER),
        .change_t = array(&c, CHANGE),
        .noise_t = array(&c, NOISE),
        .misfit_t = array(&c, MISFIT),
        .slope_t = array(&c, SLOPE),
        .ambient_t = array(&c, AMBIENT),
        .rest_t = array(&c, REST),
        .there = array(&c, THERE) == array(&c, FINGER) ? NULL : array(&c, THERE),
        .moment = array(&c, NUMBERS)[0],
        .light_n = array(&c, NUMBERS)[1],
    };
    if (!fmfts_finite(FMFTS_FINGER, array(&c, THERE))) {
        return PyErr_Format(PyExc_ValueError, "a finger that is followed is at no finite place");
    }
    fmfts_look_ahead(&c.model, &from, c.work, array(&c, AHEAD), array(&c, BY_FINGER));
    return Py_NewRef(Py_None);
}

/* covariance(model, work, fingers, field, slope, by_pose, change, pressed, variance, ambient, covariance) */
FMFTS_FUNCTION(covariance)
{
    enum { FINGERS = FIRST, PREDICTED, VARIANCE = PREDICTED + 5, AMBIENT, COVARIANCE, ALL };
    call c = {.buffer = b};
    if (!take(&c, args, COVARIANCE, ALL) || !understood(&c, FINGERS) || !has_predicted(&c, PREDICTED)) {
        return NULL;
    }
    const size_t values = c.model.values;
    if (!have_doubles(&c, VARIANCE, (size_t[]){values, 3, values * values}, ALL - VARIANCE)) {
        return NULL;
    }
    c.work->predicted[0].known = FMFTS_NOTHING;
    exchange(&c, &c.work->predicted[0], PREDICTED, false);
    fmfts_several_covariance(&c.model, fingers(&c, FINGERS), &c.work->predicted[0], array(&c, VARIANCE), array(&c, AMBIENT), c.work);
    memcpy(array(&c, COVARIANCE), c.work->covariance, values * values * sizeof(double));
    return Py_NewRef(Py_None);
}

/* resultant(finger, whole, covariance, least, deviation): the last three are None where deviations are not asked for; least may be
 * None alone. */
FMFTS_FUNCTION(resultant)
{
    enum { FINGER, WHOLE, COVARIANCE, LEAST, DEVIATION };
    if (!PyArg_ParseTuple(args, "y*w*z*z*z*", &b[FINGER], &b[WHOLE], &b[COVARIANCE], &b[LEAST], &b[DEVIATION])) {
        return NULL;
    }
    const size_t count = (size_t)b[FINGER].len / (FMFTS_FINGER * sizeof(double)), unknowns = FMFTS_FINGER * count;
    const size_t all = FMFTS_FINGER + unknowns;
    if (!fmfts_have_doubles(b, (size_t[]){unknowns, FMFTS_FINGER}, COVARIANCE) ||
        (b[LEAST].buf && !fmfts_has_doubles(&b[LEAST], all, "least")) ||
        (b[DEVIATION].buf && (!fmfts_has_doubles(&b[COVARIANCE], unknowns * unknowns, "covariance") ||
                              !fmfts_has_doubles(&b[DEVIATION], all, "deviation")))) {
        return NULL;
    }
    fmfts_resultant(count, b[FINGER].buf, b[WHOLE].buf);
    if (b[DEVIATION].buf) {
        fmfts_finger_deviations(count, b[FINGER].buf, b[COVARIANCE].buf, b[LEAST].buf, b[DEVIATION].buf);
    }
    return Py_NewRef(Py_None);
}
