/* Tables of presses for Python: refine.h, tolerances.c and press_table.h on arrays that response.py, refinement.py, model.py and
 * array_response.py make. */
#include "_presses.h"

#include <math.h>
#include <string.h>

#include "press_table.h"
#include "step.h"

/* Whether `packed` is a response; else raises. */
static int is_response(const Py_buffer *packed, fmfts_response *response)
{
    if (!fmfts_is_aligned(packed, sizeof(double))) {
        return 0;
    }
    if (fmfts_view_response(packed->buf, (size_t)packed->len, response)) {
        return 1;
    }
    PyErr_SetString(PyExc_ValueError, "the response has another size than there is room for");
    return 0;
}

/* Whether `press` holds whole presses; else raises. */
static int are_presses(const Py_buffer *press, const fmfts_response *response, size_t *count)
{
    size_t one = (2 + response->loads) * sizeof(double);
    *count = (size_t)press->len / one;
    return fmfts_has_bytes(press, *count * one, sizeof(double), "press");
}

/* respond(response, press, change, slope): of each press. */
FMFTS_FUNCTION(respond)
{
    enum { RESPONSE, PRESS, CHANGE, SLOPE };
    fmfts_response response;
    size_t count;
    if (!PyArg_ParseTuple(args, "y*y*w*w*", &b[RESPONSE], &b[PRESS], &b[CHANGE], &b[SLOPE]) ||
        !is_response(&b[RESPONSE], &response) || !are_presses(&b[PRESS], &response, &count) ||
        !fmfts_has_doubles(&b[CHANGE], count * FMFTS_MOVED, "change") ||
        !fmfts_has_bytes(&b[SLOPE], (size_t)b[PRESS].len * FMFTS_MOVED, sizeof(double), "slope")) {
        return NULL;
    }
    size_t size = 2 + response.loads;
    for (size_t k = 0; k < count; k++) {
        double slope[FMFTS_MOVED][FMFTS_MAX_PRESS], *out = (double *)b[SLOPE].buf + k * FMFTS_MOVED * size;
        fmfts_respond(&response, (double *)b[PRESS].buf + k * size, (double *)b[CHANGE].buf + k * FMFTS_MOVED, slope);
        for (size_t c = 0; c < FMFTS_MOVED; c++) {
            memcpy(out + c * size, slope[c], size * sizeof(double));
        }
    }
    return Py_NewRef(Py_None);
}

/* basis(response, press, basis): of each press. */
FMFTS_FUNCTION(basis)
{
    enum { RESPONSE, PRESS, BASIS };
    fmfts_response response;
    size_t count;
    if (!PyArg_ParseTuple(args, "y*y*w*", &b[RESPONSE], &b[PRESS], &b[BASIS]) || !is_response(&b[RESPONSE], &response) ||
        !are_presses(&b[PRESS], &response, &count)) {
        return NULL;
    }
    size_t each = (response.knots[0] + 2) * (response.knots[1] + 2) * response.monomials;
    if (!fmfts_has_doubles(&b[BASIS], count * each, "basis")) {
        return NULL;
    }
    for (size_t k = 0; k < count; k++) {
        fmfts_basis(&response, (double *)b[PRESS].buf + k * (2 + response.loads), (double *)b[BASIS].buf + k * each);
    }
    return Py_NewRef(Py_None);
}

/* refine(response, change, covariance, steps, shear_share, press, spread): χ² that fmfts_refine leaves. None if the covariance is
 * not positive definite. */
FMFTS_FUNCTION(refine)
{
    enum { RESPONSE, CHANGE, COVARIANCE, PRESS, SPREAD };
    fmfts_press_search search = {.steps = 0};
    double chi2;
    fmfts_response response;
    if (!PyArg_ParseTuple(args, "y*y*y*idw*w*", &b[RESPONSE], &b[CHANGE], &b[COVARIANCE], &search.steps, &search.shear_share, &b[PRESS],
                          &b[SPREAD]) ||
        !is_response(&b[RESPONSE], &response)) {
        return NULL;
    }
    const size_t press = 2 + response.loads, moved = FMFTS_MOVED;
    if (!fmfts_has_doubles(&b[CHANGE], moved, "change") || !fmfts_has_doubles(&b[COVARIANCE], moved * moved, "covariance") ||
        !fmfts_has_doubles(&b[PRESS], press, "press") || !fmfts_has_doubles(&b[SPREAD], press * press, "spread")) {
        return NULL;
    }
    search.change = b[CHANGE].buf;
    search.covariance = b[COVARIANCE].buf;
    bool found = fmfts_refine(&response, &search, b[PRESS].buf, b[SPREAD].buf, &chi2);
    return found ? PyFloat_FromDouble(chi2) : Py_NewRef(Py_None);
}

/* widened(response, press, wider_mm2, more): as fmfts_wider_disc. */
FMFTS_FUNCTION(widened)
{
    enum { RESPONSE, PRESS, MORE };
    double wider_mm2;
    fmfts_response response;
    if (!PyArg_ParseTuple(args, "y*y*dw*", &b[RESPONSE], &b[PRESS], &wider_mm2, &b[MORE]) ||
        !is_response(&b[RESPONSE], &response) || !fmfts_has_doubles(&b[PRESS], FMFTS_CONTACT, "press") ||
        !fmfts_has_doubles(&b[MORE], FMFTS_MOVED, "more")) {
        return NULL;
    }
    fmfts_wider_disc(&response, b[PRESS].buf, wider_mm2, b[MORE].buf);
    return Py_NewRef(Py_None);
}

/* pressed(table, width, terms, first_mm, spacing_mm, scale_n, fingers, pressed): of each finger. */
FMFTS_FUNCTION(pressed)
{
    enum { TABLE, FINGERS, PRESSED, ARRAYS };
    Py_ssize_t width, terms;
    fmfts_press_table table;
    if (!PyArg_ParseTuple(args, "y*nndddy*w*", &b[TABLE], &width, &terms, &table.first_mm, &table.spacing_mm, &table.scale_n,
                          &b[FINGERS], &b[PRESSED])) {
        return NULL;
    }
    if (width < 4 || width > 10000 || terms < 1 || terms > FMFTS_TABLE_TERMS || !isfinite(table.first_mm) ||
        !isfinite(table.spacing_mm) || !(table.spacing_mm > 0.0)) {
        PyErr_SetString(PyExc_ValueError, "the table has no spacing, or another size than there is room for");
        return NULL;
    }
    const size_t rows = (size_t)(width * width * (terms + 2)), fingers = (size_t)b[FINGERS].len / sizeof(double[FMFTS_FINGER]);
    table.width = (size_t)width;
    table.terms = (size_t)terms;
    table.poses = (size_t)b[TABLE].len / sizeof(double) / rows;
    table.table = b[TABLE].buf;
    if (table.poses > FMFTS_MOST_CHANGE) {
        return PyErr_Format(PyExc_ValueError, "%zu numbers of pose, at most %d", table.poses, FMFTS_MOST_CHANGE);
    }
    const size_t wanted[] = {rows * table.poses, FMFTS_FINGER * fingers, FMFTS_PRESSED * table.poses * fingers};
    if (!fmfts_have_doubles(b, wanted, ARRAYS)) {
        return NULL;
    }
    for (size_t k = 0; k < fingers; k++) {
        const double *finger = (double *)b[FINGERS].buf + FMFTS_FINGER * k;
        if (!isfinite(finger[0]) || !isfinite(finger[1])) {
            return PyErr_Format(PyExc_ValueError, "finger %zu has no place", k);
        }
        fmfts_press_by_table(&table, finger, true, (double *)b[PRESSED].buf + FMFTS_PRESSED * table.poses * k);
    }
    return Py_NewRef(Py_None);
}
