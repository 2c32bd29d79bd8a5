/* What a frame starts with, for Python: since_rest.py makes the arrays. */
#include "_arrays.h"

#include "since_rest.h"

/* since_rest(field, bend, gain, offset, noise, rest, allowed, recent, change, variance, share, repeats, there, foreign, now, moment,
 * creep, decay) → whether the field jumped; foreign and now are None where there is nothing. */
FMFTS_FUNCTION(since_rest)
{
    enum { FIELD, BEND, GAIN, OFFSET, NOISE, REST, ALLOWED, RECENT, CHANGE, VARIANCE, SHARE, REPEATS, THERE, FOREIGN, NOW };
    fmfts_rest_samples samples;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*y*y*w*w*w*y*y*w*z*z*ddd", &b[FIELD], &b[BEND], &b[GAIN], &b[OFFSET], &b[NOISE], &b[REST],
                          &b[ALLOWED], &b[RECENT], &b[CHANGE], &b[VARIANCE], &b[SHARE], &b[REPEATS], &b[THERE], &b[FOREIGN], &b[NOW],
                          &samples.moment, &samples.creep, &samples.decay)) {
        return NULL;
    }
    const size_t values = (size_t)b[THERE].len;
    size_t wanted[] = {values, values, values, values, values, values, values, values, values, values, values / 3};
    if (values % 3) {
        return PyErr_Format(PyExc_ValueError, "%zu values, which are not three for each sensor", values);
    }
    if (!fmfts_have_doubles(b, wanted, REPEATS) ||
        !fmfts_has_bytes(&b[REPEATS], values * sizeof(int64_t), sizeof(int64_t), "repeats") ||
        (b[FOREIGN].buf && !fmfts_has_doubles(&b[FOREIGN], values, "foreign")) ||
        (b[NOW].buf && !fmfts_has_doubles(&b[NOW], values, "now"))) {
        return NULL;
    }
    samples.field_t = b[FIELD].buf;
    samples.bend_t = b[BEND].buf;
    samples.gain = b[GAIN].buf;
    samples.offset_t = b[OFFSET].buf;
    samples.noise_t = b[NOISE].buf;
    samples.rest_t = b[REST].buf;
    samples.allowed = b[ALLOWED].buf;
    samples.noise_share = b[SHARE].buf;
    samples.repeats = b[REPEATS].buf;
    samples.foreign_t = b[FOREIGN].buf;
    samples.now_t = b[NOW].buf;
    const fmfts_rest_change found = {b[RECENT].buf, b[CHANGE].buf, b[VARIANCE].buf, b[THERE].buf};
    return PyBool_FromLong(fmfts_since_rest(values, &samples, &found));
}
