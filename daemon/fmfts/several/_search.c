/* The search for fingers for Python: fit.py and scan.py call it, and make the arrays. */
#include "_arrays.h"

#include <string.h>

static bool searches(const call *c, int which, size_t values, fmfts_search *search)
{
    const Py_buffer *packed = &c->buffer[which];
    if (!fmfts_is_aligned(packed, sizeof(double))) {
        return false;
    }
    if (values <= FMFTS_SEVERAL_VALUES &&
        fmfts_view_search(packed->buf, (size_t)packed->len / sizeof(double), values, search)) {
        return true;
    }
    PyErr_SetString(PyExc_ValueError, "the search has another size than the field, or than there is room for");
    return false;
}

/* fit(model, work, search, start, field, variance, foreign, used, ambient, fingers, covariance, misfit, ambient, shear,
 * shear_deviation) */
PyObject *fmfts_py_fit(PyObject *module, PyObject *args)
{
    enum { SEARCH = FIRST, START, FIELD, VARIANCE, FOREIGN, USED, AMBIENT, FINGERS, COVARIANCE, MISFIT, FOUND_AMBIENT, SHEAR,
           SHEAR_DEVIATION, ALL };
    call c;
    fmfts_search search;
    PyObject *result = NULL;
    (void)module;
    if (!take(&c, args, FINGERS, ALL)) {
        return NULL;
    }
    if (understood(&c, START)) {
        size_t values = c.model.values, unknowns = FMFTS_FINGER * c.fingers;
        if (searches(&c, SEARCH, values, &search) && has_doubles(&c, FIELD, values) && has_doubles(&c, VARIANCE, values) &&
            has_foreign(&c, FOREIGN) && has(&c, USED, values) && has_doubles(&c, AMBIENT, 3) &&
            has_doubles(&c, FINGERS, unknowns) &&
            has_doubles(&c, COVARIANCE, unknowns * unknowns) && has_doubles(&c, MISFIT, values) &&
            has_doubles(&c, FOUND_AMBIENT, 3) && has_doubles(&c, SHEAR, 2 * c.fingers) &&
            has_doubles(&c, SHEAR_DEVIATION, 2 * c.fingers)) {
            fmfts_measured measured = {array(&c, FIELD), array(&c, VARIANCE), c.buffer[USED].buf, foreign(&c, FOREIGN),
                                       array(&c, AMBIENT)};
            fmfts_found found = {
                .fingers = array(&c, FINGERS),
                .covariance = array(&c, COVARIANCE),
                .misfit_t = array(&c, MISFIT),
                .ambient_t = array(&c, FOUND_AMBIENT),
                .shear_n = array(&c, SHEAR),
                .shear_deviation_n = array(&c, SHEAR_DEVIATION),
            };
            fmfts_refusal refusal = fmfts_several_fit(&c.model, &search, fingers(&c, START), &measured, c.work, &found);
            result = told(refusal, found.chi2);
        }
    }
    release(&c);
    return result;
}

/* whitener(model, work, fingers, variance, foreign, used, ambient, root) */
PyObject *fmfts_py_whitener(PyObject *module, PyObject *args)
{
    enum { FINGERS = FIRST, VARIANCE, FOREIGN, USED, AMBIENT, ROOT, ALL };
    call c;
    PyObject *result = NULL;
    (void)module;
    if (!take(&c, args, ROOT, ALL)) {
        return NULL;
    }
    size_t there = used(&c, USED);
    if (understood(&c, FINGERS) && has_doubles(&c, VARIANCE, c.model.values) && has_foreign(&c, FOREIGN) &&
        has(&c, USED, c.model.values) && has_doubles(&c, AMBIENT, 3) && has_doubles(&c, ROOT, there * there)) {
        fmfts_measured measured = {.variance_t2 = array(&c, VARIANCE),
                                   .used = c.buffer[USED].buf,
                                   .foreign_t2 = foreign(&c, FOREIGN),
                                   .ambient_t = array(&c, AMBIENT)};
        fmfts_refusal refusal = fmfts_whitener(&c.model, fingers(&c, FINGERS), &measured, c.work);
        memcpy(array(&c, ROOT), c.work->root, there * there * sizeof(double));
        result = told(refusal, 0.0);
    }
    release(&c);
    return result;
}

/* chi2_with(model, work, root, fingers, field, used) */
PyObject *fmfts_py_chi2_with(PyObject *module, PyObject *args)
{
    enum { ROOT = FIRST, FINGERS, FIELD, USED, ALL };
    call c;
    PyObject *result = NULL;
    (void)module;
    if (!take(&c, args, ALL, ALL)) {
        return NULL;
    }
    size_t there = used(&c, USED);
    if (understood(&c, FINGERS) && has_doubles(&c, ROOT, there * there) && has_doubles(&c, FIELD, c.model.values) &&
        has(&c, USED, c.model.values)) {
        double chi2 = 0.0;
        fmfts_measured measured = {.field_t = array(&c, FIELD), .used = c.buffer[USED].buf};
        fmfts_refusal refusal =
            fmfts_chi2_with(&c.model, array(&c, ROOT), fingers(&c, FINGERS), &measured, c.work, &chi2);
        result = told(refusal, chi2);
    }
    release(&c);
    return result;
}

/* valley(model, work, search, fingers, away, direction, limits, field, variance, foreign, used, ambient, there, chi2) */
PyObject *fmfts_py_valley(PyObject *module, PyObject *args)
{
    enum { SEARCH = FIRST, FINGERS, AWAY, DIRECTION, LIMITS, FIELD, VARIANCE, FOREIGN, USED, AMBIENT, THERE, CHI2, ALL };
    call c;
    fmfts_search search;
    PyObject *result = NULL;
    (void)module;
    if (!take(&c, args, THERE, ALL)) {
        return NULL;
    }
    if (understood(&c, FINGERS)) {
        size_t values = c.model.values, ways = (size_t)c.buffer[CHI2].len / (2 * sizeof(double));
        size_t unknowns = FMFTS_FINGER * c.fingers, all = ways * unknowns;
        if (searches(&c, SEARCH, values, &search) && has_doubles(&c, AWAY, all) && has_doubles(&c, DIRECTION, all) &&
            has_doubles(&c, LIMITS, sizeof(fmfts_valley_limits) / sizeof(double)) && has_doubles(&c, FIELD, values) &&
            has_doubles(&c, VARIANCE, values) && has_foreign(&c, FOREIGN) && has(&c, USED, values) &&
            has_doubles(&c, AMBIENT, 3) && has_doubles(&c, THERE, 2 * all) && has_doubles(&c, CHI2, 2 * ways)) {
            fmfts_measured measured = {array(&c, FIELD), array(&c, VARIANCE), c.buffer[USED].buf, foreign(&c, FOREIGN),
                                       array(&c, AMBIENT)};
            fmfts_ways where = {ways, array(&c, AWAY), array(&c, DIRECTION), array(&c, THERE), array(&c, CHI2),
                                c.buffer[LIMITS].buf};
            result = told(fmfts_valley(&c.model, &search, fingers(&c, FINGERS), &measured, c.work, &where), 0.0);
        }
    }
    release(&c);
    return result;
}

enum { SCANNED = 0, SCAN_ROOM = FIRST, SCAN_ROOT, SCAN_FIELD, SCAN_USED, SCAN_FOUND, SCAN_ALL };

/* A grid, and what it points to. */
typedef struct {
    fmfts_search search;
    fmfts_measured measured;
    fmfts_grid grid;
} scanned;

/* Arrays search, work, room, root, field, used, others …, found: of a scan that fills `found`, with so many `others`. */
static bool scans(call *c, PyObject *args, int others, scanned *s)
{
    if (!take(c, args, SCAN_FOUND + others, SCAN_ALL + others)) {
        return false;
    }
    size_t there = used(c, SCAN_USED), values = (size_t)c->buffer[SCAN_USED].len;
    c->work = c->buffer[WORK].buf;
    s->measured = (fmfts_measured){.field_t = array(c, SCAN_FIELD), .used = c->buffer[SCAN_USED].buf};
    s->grid = (fmfts_grid){&s->search, array(c, SCAN_ROOT), &s->measured, c->work, array(c, SCAN_ROOM)};
    if (searches(c, SCANNED, values, &s->search) && has_doubles(c, WORK, WORK_DOUBLES) &&
        has_doubles(c, SCAN_ROOM, FMFTS_SCAN_DOUBLES(values, s->search.panels * FMFTS_PANEL)) &&
        has_doubles(c, SCAN_ROOT, there * there) && has_doubles(c, SCAN_FIELD, values)) {
        return true;
    }
    release(c);
    return false;
}

static PyObject *finite_or_told(bool finite, double number)
{
    return told((fmfts_refusal){finite ? FMFTS_FINE : FMFTS_NOT_FINITE, 0}, number);
}

/* best_single(search, work, room, root, field, used, finger): the number is its gain. */
PyObject *fmfts_py_best_single(PyObject *module, PyObject *args)
{
    call c;
    scanned s;
    PyObject *result = NULL;
    (void)module;
    if (!scans(&c, args, 0, &s)) {
        return NULL;
    }
    if (has_doubles(&c, SCAN_FOUND, FMFTS_FINGER)) {
        double gain = 0.0;
        bool finite = fmfts_best_single(&s.grid, array(&c, SCAN_FOUND), &gain);
        result = finite_or_told(finite, gain);
    }
    release(&c);
    return result;
}

/* best_pairs(search, work, room, root, field, used, starts): as many as fit. The number is how many. */
PyObject *fmfts_py_best_pairs(PyObject *module, PyObject *args)
{
    call c;
    scanned s;
    PyObject *result = NULL;
    (void)module;
    if (!scans(&c, args, 0, &s)) {
        return NULL;
    }
    size_t most = (size_t)c.buffer[SCAN_FOUND].len / (2 * FMFTS_FINGER * sizeof(double)), count = 0;
    if (most > FMFTS_SEVERAL_STARTS) {
        PyErr_Format(PyExc_ValueError, "%zu pairs, at most %d", most, FMFTS_SEVERAL_STARTS);
    } else if (has_doubles(&c, SCAN_FOUND, 2 * FMFTS_FINGER * most)) {
        bool finite = fmfts_best_pairs(&s.grid, most, array(&c, SCAN_FOUND), &count);
        result = finite_or_told(finite, (double)count);
    }
    release(&c);
    return result;
}

/* another(search, work, room, root, field, used, predicted, slope, found): found [2 + unknowns][places]. */
PyObject *fmfts_py_another(PyObject *module, PyObject *args)
{
    enum { PREDICTED = SCAN_FOUND, SLOPE, FOUND };
    call c;
    scanned s;
    PyObject *result = NULL;
    (void)module;
    if (!scans(&c, args, FOUND - PREDICTED, &s)) {
        return NULL;
    }
    size_t values = s.search.values, unknowns = (size_t)c.buffer[SLOPE].len / (values * sizeof(double));
    if (unknowns > FMFTS_SEVERAL_UNKNOWNS) {
        PyErr_Format(PyExc_ValueError, "%zu unknowns, at most %d", unknowns, FMFTS_SEVERAL_UNKNOWNS);
    } else if (has_doubles(&c, PREDICTED, values) && has_doubles(&c, SLOPE, values * unknowns) &&
               has_doubles(&c, FOUND, (2 + unknowns) * s.search.places)) {
        const fmfts_others others = {unknowns, array(&c, PREDICTED), array(&c, SLOPE)};
        result = told(fmfts_another(&s.grid, &others, array(&c, FOUND)), 0.0);
    }
    release(&c);
    return result;
}
