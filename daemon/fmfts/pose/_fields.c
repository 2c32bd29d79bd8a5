/* Fields and readings for Python: model.h, magnets.c and prepare.c on arrays that dipole.py, magnets.py and kernel.py make. */
#include "_kernel.h"

#include <math.h>

#include "magnets.h"
#include "search.h"

/* dipole(places, position, axis, strength, octupole, field, by_position, by_axis): of one magnet at many places. */
FMFTS_FUNCTION(dipole)
{
    enum { PLACES, POSITION, AXIS, FIELD, BY_POSITION, BY_AXIS, ARRAYS };
    fmfts_source source;
    if (!PyArg_ParseTuple(args, "y*y*y*ddw*w*w*", &b[PLACES], &b[POSITION], &b[AXIS], &source.strength, &source.octupole,
                          &b[FIELD], &b[BY_POSITION], &b[BY_AXIS])) {
        return NULL;
    }
    const size_t places = (size_t)b[PLACES].len / sizeof(double[3]), all = 3 * places;
    if (!fmfts_have_doubles(b, (size_t[]){all, 3, 3, all, 3 * all, 3 * all}, ARRAYS)) {
        return NULL;
    }
    source.position = b[POSITION].buf;
    source.axis = b[AXIS].buf;
    tangent_basis(source.axis, source.basis);
    for (size_t i = 0; i < places; i++) {
        fmfts_sight sight;
        look(&source, (double *)b[PLACES].buf + 3 * i, &sight);
        differentiate(&source, &sight, (double *)b[FIELD].buf + 3 * i, (double(*)[3])b[BY_POSITION].buf + 3 * i,
                      (double(*)[3])b[BY_AXIS].buf + 3 * i);
    }
    return Py_NewRef(Py_None);
}

/* move(frames, position, change, moved, axis): of each magnet. */
FMFTS_FUNCTION(move)
{
    enum { FRAMES, POSITION, CHANGE, MOVED, AXIS, ARRAYS };
    if (!PyArg_ParseTuple(args, "y*y*y*w*w*", &b[FRAMES], &b[POSITION], &b[CHANGE], &b[MOVED], &b[AXIS])) {
        return NULL;
    }
    const size_t count = (size_t)b[POSITION].len / sizeof(double[3]), all = 3 * count;
    if (!fmfts_have_doubles(b, (size_t[]){3 * all, all, FMFTS_POSE_CHANGE * count, all, all}, ARRAYS)) {
        return NULL;
    }
    for (size_t i = 0; i < count; i++) {
        fmfts_move_magnet((double *)b[FRAMES].buf + 9 * i, (double *)b[POSITION].buf + 3 * i,
                          (double *)b[CHANGE].buf + FMFTS_POSE_CHANGE * i, (double *)b[MOVED].buf + 3 * i,
                          (double *)b[AXIS].buf + 3 * i);
    }
    return Py_NewRef(Py_None);
}

/* fields(position, axis, frames, strength, octupole, places, axes, field, slope): of all magnets together. */
FMFTS_FUNCTION(fields)
{
    enum { POSITION, AXIS, FRAMES, STRENGTH, OCTUPOLE, PLACES, AXES, FIELD, SLOPE, ARRAYS };
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*y*y*w*w*", &b[POSITION], &b[AXIS], &b[FRAMES], &b[STRENGTH], &b[OCTUPOLE], &b[PLACES],
                          &b[AXES], &b[FIELD], &b[SLOPE])) {
        return NULL;
    }
    const size_t count = (size_t)b[STRENGTH].len / sizeof(double), sensors = (size_t)b[PLACES].len / sizeof(double[3]);
    const size_t values = 3 * sensors, wanted[ARRAYS] = {3 * count, 3 * count, 9 * count,  count, count,
                                                         values,    9 * sensors, values, values * FMFTS_POSE_CHANGE * count};
    if (count > FMFTS_MOST_TOGETHER) {
        return PyErr_Format(PyExc_ValueError, "%zu magnets: a pad has %d at most", count, FMFTS_MOST_TOGETHER);
    }
    if (!fmfts_have_doubles(b, wanted, ARRAYS)) {
        return NULL;
    }
    fmfts_fields(&(fmfts_together){count, sensors, b[POSITION].buf, b[AXIS].buf, b[FRAMES].buf, b[STRENGTH].buf, b[OCTUPOLE].buf,
                                   b[PLACES].buf, b[AXES].buf},
                 b[FIELD].buf, b[SLOPE].buf);
    return Py_NewRef(Py_None);
}

/* The sources of a state of so many magnets, whose ambient field may have a gradient. */
static void begin_at(fmfts_sources *sources, const double *magnets, size_t count, const double *state)
{
    sources->count = count;
    sources->with_gradient = true;
    fmfts_fill(sources->log_moment, count, NAN);
    place_sources(magnets, state, sources);
}

/* How many magnets an array holds; 0 and ValueError if that is no number of them. */
static size_t count_magnets(const Py_buffer *magnets)
{
    const size_t count = (size_t)magnets->len / (FMFTS_MAGNET * sizeof(double));
    if (count < 1 || count > FMFTS_MAX_MAGNETS) {
        PyErr_Format(PyExc_ValueError, "%zu magnets: 1 to %d fit into one state", count, FMFTS_MAX_MAGNETS);
        return 0;
    }
    return count;
}

/* read(rows, magnets, state, predicted, jacobian): what each measurement would read, and its derivative by a step. */
FMFTS_FUNCTION(read)
{
    enum { ROWS, ARE_MAGNETS, AT, PREDICTED, JACOBIAN, ARRAYS };
    fmfts_sources sources;
    if (!PyArg_ParseTuple(args, "y*y*y*w*w*", &b[ROWS], &b[ARE_MAGNETS], &b[AT], &b[PREDICTED], &b[JACOBIAN])) {
        return NULL;
    }
    const size_t rows = (size_t)b[PREDICTED].len / sizeof(double), count = count_magnets(&b[ARE_MAGNETS]);
    const size_t columns = FMFTS_COLUMNS(count), wanted[] = {FMFTS_MEASUREMENT * rows, FMFTS_MAGNET * count, FMFTS_VALUES(count),
                                                             rows, columns * rows};
    if (!count || !fmfts_have_doubles(b, wanted, ARRAYS)) {
        return NULL;
    }
    begin_at(&sources, b[ARE_MAGNETS].buf, count, b[AT].buf);
    for (size_t i = 0; i < rows; i++) {
        const double *row = (double *)b[ROWS].buf + FMFTS_MEASUREMENT * i;
        fmfts_sight sight[FMFTS_MAX_MAGNETS];
        look_all(&sources, row, sight);
        ((double *)b[PREDICTED].buf)[i] =
            sense_all(&sources, sight, b[AT].buf, row, row + 3, (double *)b[JACOBIAN].buf + columns * i);
    }
    return Py_NewRef(Py_None);
}

/* deviations(rows, magnets, start, rate, diffusion, deviations): as fmfts_prepare_rows has them, infinite where a measurement is left
 * out. False if one is invalid. */
FMFTS_FUNCTION(deviations)
{
    enum { ROWS, ARE_MAGNETS, AT, RATES, SPREADS, DEVIATIONS, ARRAYS };
    fmfts_pose_search search;
    if (!PyArg_ParseTuple(args, "y*y*y*z*z*w*", &b[ROWS], &b[ARE_MAGNETS], &b[AT], &b[RATES], &b[SPREADS], &b[DEVIATIONS])) {
        return NULL;
    }
    const size_t rows = (size_t)b[DEVIATIONS].len / sizeof(double), count = count_magnets(&b[ARE_MAGNETS]);
    const size_t columns = FMFTS_COLUMNS(count), wanted[] = {FMFTS_MEASUREMENT * rows, FMFTS_MAGNET * count, FMFTS_VALUES(count),
                                                             b[RATES].buf ? columns : 0, b[SPREADS].buf ? columns : 0, rows};
    if (!count || !fmfts_have_doubles(b, wanted, ARRAYS)) {
        return NULL;
    }
    bool valid = true;
    fmfts_problem problem = {.rows = 1, .start = b[AT].buf, .rate = b[RATES].buf, .diffusion = b[SPREADS].buf};
    search.problem = &problem;
    search.columns = columns;
    begin_at(&search.sources, b[ARE_MAGNETS].buf, count, b[AT].buf);
    for (size_t i = 0; valid && i < rows; i++) {
        fmfts_row row;
        problem.measurements = (double *)b[ROWS].buf + FMFTS_MEASUREMENT * i;
        valid = fmfts_prepare_rows(&search, &row);
        ((double *)b[DEVIATIONS].buf)[i] = search.row_count ? row.deviation : INFINITY;
    }
    return PyBool_FromLong(valid);
}
