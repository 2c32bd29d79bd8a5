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

enum { FIT_ARRAYS = 8 };

/* The arrays of a Fit, from `first` on. False with an exception if they have another size than so many fingers need. */
static bool has_fit(const call *c, int first, fmfts_found *found)
{
    const size_t values = c->model.values, unknowns = FMFTS_FINGER * c->fingers, shears = 2 * c->fingers;
    const size_t doubles[FIT_ARRAYS] = {unknowns, unknowns * unknowns, values, 3, shears, shears, values, values * unknowns};
    double **const part[FIT_ARRAYS] = {&found->fingers, &found->covariance,        &found->misfit_t, &found->ambient_t,
                                       &found->shear_n, &found->shear_deviation_n, &found->noise_t,  &found->slope_t};
    for (int i = 0; i < FIT_ARRAYS; i++) {
        *part[i] = array(c, first + i);
    }
    return have_doubles(c, first, doubles, FIT_ARRAYS);
}

/* fit(model, work, search, start, field, variance, foreign, used, ambient, fingers, covariance, misfit, ambient, shear,
 * shear_deviation, noise, slope): with Fit's flags, and how many values there are. */
FMFTS_FUNCTION(fit)
{
    enum { SEARCH = FIRST, START, FIELD, FOUND = FIELD + 5, ALL = FOUND + FIT_ARRAYS };
    _Static_assert((int)ALL <= (int)FMFTS_MOST_ARRAYS, "more arrays than one call takes");
    call c = {.buffer = b};
    fmfts_search search;
    fmfts_measured measured;
    fmfts_found found;
    if (!take(&c, args, FOUND, ALL) || !understood(&c, START) || !searches(&c, SEARCH, c.model.values, &search) ||
        !measures_field(&c, FIELD, &measured) || !has_fit(&c, FOUND, &found)) {
        return NULL;
    }
    fmfts_refusal refusal = fmfts_several_fit(&c.model, &search, fingers(&c, START), &measured, c.work, &found);
    return Py_BuildValue("Nin", told(refusal, found.chi2), found.flags, (Py_ssize_t)c.work->used);
}

/* whitener(model, work, fingers, variance, foreign, used, ambient, root) */
FMFTS_FUNCTION(whitener)
{
    enum { FINGERS = FIRST, VARIANCE, FOREIGN, USED, AMBIENT, ROOT, ALL };
    call c = {.buffer = b};
    fmfts_measured measured;
    if (!take(&c, args, ROOT, ALL)) {
        return NULL;
    }
    const size_t there = used(&c, USED);
    if (!understood(&c, FINGERS) || !measures(&c, VARIANCE, &measured) || !has_doubles(&c, ROOT, there * there)) {
        return NULL;
    }
    fmfts_refusal refusal = fmfts_whitener(&c.model, fingers(&c, FINGERS), &measured, c.work);
    memcpy(array(&c, ROOT), c.work->root, there * there * sizeof(double));
    return told(refusal, 0.0);
}

/* chi2_with(model, work, root, fingers, field, used) */
FMFTS_FUNCTION(chi2_with)
{
    enum { ROOT = FIRST, FINGERS, FIELD, USED, ALL };
    call c = {.buffer = b};
    double chi2 = 0.0;
    if (!take(&c, args, ALL, ALL)) {
        return NULL;
    }
    const size_t there = used(&c, USED);
    if (!understood(&c, FINGERS) || !has_doubles(&c, ROOT, there * there) || !has_doubles(&c, FIELD, c.model.values) ||
        !has(&c, USED, c.model.values)) {
        return NULL;
    }
    fmfts_measured measured = {.field_t = array(&c, FIELD), .used = c.buffer[USED].buf};
    fmfts_refusal refusal = fmfts_chi2_with(&c.model, array(&c, ROOT), fingers(&c, FINGERS), &measured, c.work, &chi2);
    return told(refusal, chi2);
}

/* valley(model, work, search, fingers, fingers_covariance, chi2, limits, field, variance, foreign, used, ambient, least): the number is
 * how many fingers are uncertain. */
FMFTS_FUNCTION(valley)
{
    enum { SEARCH = FIRST, FINGERS, COVARIANCE, CHI2, LIMITS, FIELD, LEAST = FIELD + 5, ALL };
    call c = {.buffer = b};
    fmfts_search search;
    fmfts_measured measured;
    if (!take(&c, args, LEAST, ALL) || !understood(&c, FINGERS)) {
        return NULL;
    }
    const size_t unknowns = FMFTS_FINGER * c.fingers, limits = sizeof(fmfts_valley_limits) / sizeof(double);
    if (!searches(&c, SEARCH, c.model.values, &search) || !measures_field(&c, FIELD, &measured) ||
        !have_doubles(&c, COVARIANCE, (size_t[]){unknowns * unknowns, 1, limits}, FIELD - COVARIANCE) ||
        !has_doubles(&c, LEAST, FMFTS_FINGER + unknowns)) {
        return NULL;
    }
    const fmfts_fitter fitter = {&c.model, &search, c.work};
    const fmfts_fitted fitted = {fingers(&c, FINGERS), array(&c, COVARIANCE), NULL, *array(&c, CHI2)};
    fmfts_valley_found found = {0, array(&c, LEAST)};
    fmfts_refusal refusal = fmfts_valley(&fitter, &fitted, &measured, c.buffer[LIMITS].buf, &found);
    return told(refusal, (double)found.ways);
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
    return searches(c, SCANNED, values, &s->search) && has_doubles(c, WORK, WORK_DOUBLES) &&
           has_doubles(c, SCAN_ROOM, FMFTS_SCAN_DOUBLES(values, s->search.panels * FMFTS_PANEL)) &&
           has_doubles(c, SCAN_ROOT, there * there) && has_doubles(c, SCAN_FIELD, values);
}

static PyObject *finite_or_told(bool finite, double number)
{
    return told((fmfts_refusal){finite ? FMFTS_FINE : FMFTS_NOT_FINITE, 0}, number);
}

/* best_single(search, work, room, root, field, used, finger): the number is its gain. */
FMFTS_FUNCTION(best_single)
{
    call c = {.buffer = b};
    scanned s;
    double gain = 0.0;
    if (!scans(&c, args, 0, &s) || !has_doubles(&c, SCAN_FOUND, FMFTS_FINGER)) {
        return NULL;
    }
    bool finite = fmfts_best_single(&s.grid, array(&c, SCAN_FOUND), &gain);
    return finite_or_told(finite, gain);
}

/* best_pairs(search, work, room, root, field, used, starts): as many as fit. The number is how many. */
FMFTS_FUNCTION(best_pairs)
{
    call c = {.buffer = b};
    scanned s;
    if (!scans(&c, args, 0, &s)) {
        return NULL;
    }
    size_t most = (size_t)c.buffer[SCAN_FOUND].len / (2 * FMFTS_FINGER * sizeof(double)), count = 0;
    if (most > FMFTS_SEVERAL_STARTS) {
        return PyErr_Format(PyExc_ValueError, "%zu pairs, at most %d", most, FMFTS_SEVERAL_STARTS);
    }
    if (!has_doubles(&c, SCAN_FOUND, 2 * FMFTS_FINGER * most)) {
        return NULL;
    }
    bool finite = fmfts_best_pairs(&s.grid, most, array(&c, SCAN_FOUND), &count);
    return finite_or_told(finite, (double)count);
}

/* another(search, work, room, root, field, used, predicted, slope, found): found [2 + unknowns][places]. */
FMFTS_FUNCTION(another)
{
    enum { PREDICTED = SCAN_FOUND, SLOPE, FOUND, ALL };
    call c = {.buffer = b};
    scanned s;
    if (!scans(&c, args, FOUND - PREDICTED, &s)) {
        return NULL;
    }
    const size_t values = s.search.values, unknowns = (size_t)c.buffer[SLOPE].len / (values * sizeof(double));
    if (unknowns > FMFTS_SEVERAL_UNKNOWNS) {
        return PyErr_Format(PyExc_ValueError, "%zu unknowns, at most %d", unknowns, FMFTS_SEVERAL_UNKNOWNS);
    }
    const size_t wanted[] = {values, values * unknowns, (2 + unknowns) * s.search.places};
    if (!have_doubles(&c, PREDICTED, wanted, ALL - PREDICTED)) {
        return NULL;
    }
    const fmfts_others others = {unknowns, array(&c, PREDICTED), array(&c, SLOPE)};
    return told(fmfts_another(&s.grid, &others, array(&c, FOUND)), 0.0);
}
