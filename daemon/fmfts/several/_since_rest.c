/* What a frame starts with, for Python: since_rest.py makes the arrays. */
#include "_arrays.h"

/* since_rest(rest, factors, field, bend, share, repeats, recent, change, variance, there, foreign, now) → whether the field jumped;
 * foreign and now are None where there is nothing. */
FMFTS_FUNCTION(since_rest)
{
    enum { REST, FACTORS, FIELD, BEND, SHARE, REPEATS, RECENT, CHANGE, VARIANCE, THERE, FOREIGN, NOW };
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*y*w*w*w*w*z*z*", &b[REST], &b[FACTORS], &b[FIELD], &b[BEND], &b[SHARE], &b[REPEATS],
                          &b[RECENT], &b[CHANGE], &b[VARIANCE], &b[THERE], &b[FOREIGN], &b[NOW])) {
        return NULL;
    }
    const size_t values = (size_t)b[THERE].len;
    if (values % 3) {
        return PyErr_Format(PyExc_ValueError, "%zu values, which are not three for each sensor", values);
    }
    if (!fmfts_have_doubles(b, (size_t[]){5 * values, 3, values, values, values / 3, values, values, values, values}, THERE) ||
        (b[FOREIGN].buf && !fmfts_has_doubles(&b[FOREIGN], values, "foreign")) ||
        (b[NOW].buf && !fmfts_has_doubles(&b[NOW], values, "now"))) {
        return NULL;
    }
    fmfts_rest_samples samples = fmfts_samples_of(values, b[REST].buf, b[FACTORS].buf);
    samples.field_t = b[FIELD].buf;
    samples.bend_t = b[BEND].buf;
    samples.noise_share = b[SHARE].buf;
    samples.repeats = b[REPEATS].buf;
    samples.foreign_t = b[FOREIGN].buf;
    samples.now_t = b[NOW].buf;
    const fmfts_rest_change found = {b[RECENT].buf, b[CHANGE].buf, b[VARIANCE].buf, b[THERE].buf};
    return PyBool_FromLong(fmfts_since_rest(values, &samples, &found));
}
