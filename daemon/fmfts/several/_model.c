/* Prediction and covariance for Python: field_model.py calls them, and makes the arrays. */
#include "_arrays.h"

#include <string.h>

/* Copies what is predicted to arrays, or back from them: field, slope, by_pose, change, pressed, from array `first` on. */
static void exchange(const call *c, int first, bool out)
{
    const fmfts_several *m = &c->model;
    fmfts_predicted *p = &c->work->predicted[0];
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
    const fmfts_several *m = &c->model;
    return has_doubles(c, first, m->values) && has_doubles(c, first + 1, m->values * FMFTS_FINGER * c->fingers) &&
           has_doubles(c, first + 2, m->values * m->poses) && has_doubles(c, first + 3, m->poses) &&
           has_doubles(c, first + 4, c->fingers * FMFTS_PRESSED * m->poses);
}

/* predict(model, work, fingers, field, slope, by_pose, change, pressed): False where a finger is not finite. */
PyObject *fmfts_py_predict(PyObject *module, PyObject *args)
{
    enum { FINGERS = FIRST, PREDICTED, ALL = PREDICTED + 5 };
    call c;
    PyObject *result = NULL;
    (void)module;
    if (!take(&c, args, PREDICTED, ALL)) {
        return NULL;
    }
    if (understood(&c, FINGERS) && has_predicted(&c, PREDICTED)) {
        bool finite = fmfts_finite(FMFTS_FINGER * c.fingers, array(&c, FINGERS));
        if (finite) {
            fmfts_predict(&c.model, fingers(&c, FINGERS), &c.work->predicted[0]);
            exchange(&c, PREDICTED, true);
        }
        result = PyBool_FromLong(finite);
    }
    release(&c);
    return result;
}

/* covariance(model, work, fingers, field, slope, by_pose, change, pressed, variance, ambient, covariance) */
PyObject *fmfts_py_covariance(PyObject *module, PyObject *args)
{
    enum { FINGERS = FIRST, PREDICTED, VARIANCE = PREDICTED + 5, AMBIENT, COVARIANCE, ALL };
    call c;
    PyObject *result = NULL;
    (void)module;
    if (!take(&c, args, COVARIANCE, ALL)) {
        return NULL;
    }
    size_t values;
    if (understood(&c, FINGERS) && has_predicted(&c, PREDICTED) && (values = c.model.values) &&
        has_doubles(&c, VARIANCE, values) && has_doubles(&c, AMBIENT, 3) && has_doubles(&c, COVARIANCE, values * values)) {
        exchange(&c, PREDICTED, false);
        fmfts_several_covariance(&c.model, fingers(&c, FINGERS), &c.work->predicted[0], array(&c, VARIANCE), array(&c, AMBIENT),
                                 c.work);
        memcpy(array(&c, COVARIANCE), c.work->covariance, values * values * sizeof(double));
        result = Py_NewRef(Py_None);
    }
    release(&c);
    return result;
}
