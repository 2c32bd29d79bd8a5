/* What a frame starts with, for Python: since_rest.py makes the arrays. */
#include "_arrays.h"

#include "since_rest.h"

/* since_rest(field, bend, gain, offset, noise, rest, recent, change, variance, share, there, foreign, now, moment, creep): foreign
 * and now are None where there is nothing. */
FMFTS_FUNCTION(since_rest)
{
    enum { FIELD, BEND, GAIN, OFFSET, NOISE, REST, RECENT, CHANGE, VARIANCE, SHARE, THERE, FOREIGN, NOW };
    double moment, creep;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*y*y*w*w*y*y*z*z*dd", &b[FIELD], &b[BEND], &b[GAIN], &b[OFFSET], &b[NOISE], &b[REST],
                          &b[RECENT], &b[CHANGE], &b[VARIANCE], &b[SHARE], &b[THERE], &b[FOREIGN], &b[NOW], &moment, &creep)) {
        return NULL;
    }
    const size_t values = (size_t)b[THERE].len;
    size_t wanted[] = {values, values, values, values, values, values, values, values, values, values / 3};
    if (values % 3) {
        return PyErr_Format(PyExc_ValueError, "%zu values, which are not three for each sensor", values);
    }
    if (!fmfts_have_doubles(b, wanted, THERE) || (b[FOREIGN].buf && !fmfts_has_doubles(&b[FOREIGN], values, "foreign")) ||
        (b[NOW].buf && !fmfts_has_doubles(&b[NOW], values, "now"))) {
        return NULL;
    }
    const fmfts_rest_samples samples = {b[FIELD].buf, b[SHARE].buf,   b[BEND].buf,   b[GAIN].buf, b[OFFSET].buf, b[NOISE].buf,
                                        b[REST].buf,  b[FOREIGN].buf, b[RECENT].buf, b[NOW].buf,  b[THERE].buf};
    fmfts_since_rest(values, &samples, moment, creep, b[CHANGE].buf, b[VARIANCE].buf);
    return Py_NewRef(Py_None);
}

/* list_present(field, allowed, repeats, there) → whether all are there. */
FMFTS_FUNCTION(list_present)
{
    enum { FIELD, ALLOWED, REPEATS, THERE };
    if (!PyArg_ParseTuple(args, "y*y*y*w*", &b[FIELD], &b[ALLOWED], &b[REPEATS], &b[THERE])) {
        return NULL;
    }
    const size_t values = (size_t)b[THERE].len;
    if (!fmfts_have_doubles(b, (size_t[]){values, values}, REPEATS) ||
        !fmfts_has_bytes(&b[REPEATS], values * sizeof(int64_t), sizeof(int64_t), "repeats")) {
        return NULL;
    }
    return PyBool_FromLong(fmfts_list_present(values, b[FIELD].buf, b[REPEATS].buf, b[ALLOWED].buf, b[THERE].buf));
}
