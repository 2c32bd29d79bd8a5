/* fmfts.pose._alignment: push.c, beside.c and joints.c for Python, through the stable ABI. alignment.py and neighbour.py make the
 * arrays. */
#include "../common/_binding.h"

#include "beside.h"
#include "joints.h"
#include "limits.h"
#include "push.h"

/* The memory, the frame, and what is written, in the order of the arguments. */
enum { FIELDS, TIMES, REPEATS, FIELD, TIME, FRESH, TIMED, ALIGNED, SHARE, BEND, REPEATED, BUFFERS };

static int sizes_agree(const Py_buffer *b, Py_ssize_t sensors)
{
    const Py_ssize_t wanted[BUFFERS] = {
        [FIELDS] = 72 * sensors, [TIMES] = 24 * sensors,   [REPEATS] = 24 * sensors, [FIELD] = 24 * sensors,
        [TIME] = 8 * sensors,    [FRESH] = sensors,        [TIMED] = sensors,        [ALIGNED] = 24 * sensors,
        [SHARE] = 8 * sensors,   [BEND] = 24 * sensors,    [REPEATED] = 24 * sensors,
    };
    for (int i = 0; i < BUFFERS; i++) {
        if (b[i].buf && b[i].len != wanted[i]) {
            PyErr_Format(PyExc_ValueError, "array %d has %zd bytes, %zd expected for %zd sensors", i, b[i].len, wanted[i],
                         sensors);
            return 0;
        }
        if (i != FRESH && i != TIMED && !fmfts_is_aligned(&b[i], sizeof(double))) {
            return 0;
        }
    }
    return 1;
}

/* Whether differences of these times fit into 64 bits. A board's clock has 48 bits; a recording may contain any time.
 * */
static int times_are_possible(const int64_t *time, Py_ssize_t sensors, long long frame_us)
{
    const int64_t most = (int64_t)1 << 53;
    bool possible = -most <= frame_us && frame_us <= most;
    for (Py_ssize_t i = 0; i < sensors; i++) {
        possible = possible && -most <= time[i] && time[i] <= most;
    }
    if (!possible) {
        PyErr_SetString(PyExc_ValueError, "a sample's time is more than 2^53 us: no board's clock counts so far");
    }
    return possible;
}

/* Whether differences of these fit into 64 bits. */
static int numbers_are_possible(const int64_t *number, int count)
{
    const int64_t most = (int64_t)1 << 61;
    for (int i = 0; i < count; i++) {
        if (number[i] < -most || number[i] > most) {
            PyErr_SetString(PyExc_ValueError, "a time of the host, or a frame's number, is more than 2^61: nothing counts so far");
            return 0;
        }
    }
    return 1;
}

/* push(fields, times, repeats, field, time, fresh, timed, aligned, share, bend, repeated, period, without_news, has_time,
 * frame): the instant, whether it is old, whether the clock began anew, and how many frames in a row brought nothing. */
FMFTS_FUNCTION(push)
{
    double period_us;
    long long without_news, frame_us;
    int has_time;
    if (!PyArg_ParseTuple(args, "w*w*w*y*y*y*z*w*w*w*w*dLpL", &b[FIELDS], &b[TIMES], &b[REPEATS], &b[FIELD], &b[TIME],
                          &b[FRESH], &b[TIMED], &b[ALIGNED], &b[SHARE], &b[BEND], &b[REPEATED], &period_us,
                          &without_news, &has_time, &frame_us)) {
        return NULL;
    }
    Py_ssize_t sensors = b[FRESH].len;
    if (sensors < 1) {
        PyErr_SetString(PyExc_ValueError, "a frame of no sensors");
        return NULL;
    }
    if (!sizes_agree(b, sensors) || !times_are_possible(b[TIME].buf, sensors, frame_us) ||
        !times_are_possible(b[TIMES].buf, 3 * sensors, 0)) {
        return NULL;
    }
    const fmfts_periods periods = fmfts_periods_of(period_us);
    fmfts_samples samples = {(size_t)sensors, b[FIELDS].buf, b[TIMES].buf, b[REPEATS].buf, without_news};
    fmfts_pushed frame = {b[FIELD].buf, b[TIME].buf, b[FRESH].buf, b[TIMED].buf, has_time != 0, frame_us};
    fmfts_aligned aligned = {
        .field_t = b[ALIGNED].buf, .noise_share = b[SHARE].buf, .bend_t = b[BEND].buf, .repeats = b[REPEATED].buf};
    fmfts_push(&periods, &samples, &frame, &aligned);
    return Py_BuildValue("LNNL", (long long)aligned.time_us, PyBool_FromLong(aligned.is_old),
                         PyBool_FromLong(aligned.began_anew), (long long)samples.without_news);
}

/* leap_us(last frame_us, stood_ns, stood_sequence, frame_us, host_ns, sequence, period_us) → the leap. */
FMFTS_FUNCTION(leap_us)
{
    long long last_us, stood_ns, stood_sequence, frame_us, host_ns, sequence;
    double period_us;
    (void)b;
    if (!PyArg_ParseTuple(args, "LLLLLLd", &last_us, &stood_ns, &stood_sequence, &frame_us, &host_ns, &sequence, &period_us) ||
        !times_are_possible((const int64_t[2]){last_us, frame_us}, 2, 0) ||
        !numbers_are_possible((const int64_t[4]){stood_ns, host_ns, stood_sequence, sequence}, 4)) {
        return NULL;
    }
    const fmfts_last last = {last_us, stood_ns, stood_sequence};
    return PyLong_FromLongLong(fmfts_leap_us(&last, frame_us, host_ns, sequence, period_us));
}

/* see(turn, place, sighting, time_ns, rest, now, covariance): as fmfts_see. */
FMFTS_FUNCTION(see)
{
    enum { TURN, PLACE, SIGHTING, REST, NOW, COVARIANCE, ARRAYS };
    double time_ns;
    if (!PyArg_ParseTuple(args, "y*y*w*dw*w*w*", &b[TURN], &b[PLACE], &b[SIGHTING], &time_ns, &b[REST], &b[NOW], &b[COVARIANCE])) {
        return NULL;
    }
    const size_t magnets = (size_t)b[NOW].len / sizeof(double[FMFTS_PLACED]), width = FMFTS_MOVES * magnets;
    const size_t placed = FMFTS_PLACED * magnets;
    if (magnets > FMFTS_MOST_TOGETHER) {
        return PyErr_Format(PyExc_ValueError, "%zu magnets, at most %d", magnets, FMFTS_MOST_TOGETHER);
    }
    if (!fmfts_have_doubles(b, (size_t[]){9, 3, FMFTS_SIGHTING(magnets), placed, placed, width * width}, ARRAYS)) {
        return NULL;
    }
    const fmfts_sighting sighting = fmfts_view_sighting(b[SIGHTING].buf, magnets);
    fmfts_see(b[TURN].buf, b[PLACE].buf, &sighting, time_ns, &(fmfts_seen){b[REST].buf, b[NOW].buf, b[COVARIANCE].buf, width});
    return Py_NewRef(Py_None);
}

/* change_beside(places, directions, magnets, rest, now, rest_error, covariance, placement_m, rest_t, change_t, covariance_t2) */
FMFTS_FUNCTION(change_beside)
{
    enum { PLACES, DIRECTIONS, MAGNETS, REST, NOW, REST_ERROR, COVARIANCE, REST_T, CHANGE_T, COVARIANCE_T2, ARRAYS };
    double placement_m;
    if (!PyArg_ParseTuple(args, "y*y*y*y*y*y*y*dw*w*w*", &b[PLACES], &b[DIRECTIONS], &b[MAGNETS], &b[REST], &b[NOW], &b[REST_ERROR],
                          &b[COVARIANCE], &placement_m, &b[REST_T], &b[CHANGE_T], &b[COVARIANCE_T2])) {
        return NULL;
    }
    const size_t sensors = (size_t)b[PLACES].len / sizeof(double[3]), magnets = (size_t)b[NOW].len / sizeof(double[FMFTS_PLACED]);
    const size_t axes = 3 * sensors, placed = FMFTS_PLACED * magnets, columns = FMFTS_MOVES * magnets;
    const size_t wanted[] = {axes, 3 * axes, FMFTS_MAGNET * magnets, placed, placed, 2 * magnets, columns * columns,
                             axes, axes,     axes * axes};
    if (magnets > FMFTS_MOST_TOGETHER || sensors > FMFTS_SENSORS) {
        return PyErr_Format(PyExc_ValueError, "%zu magnets and %zu sensors, at most %d and %d", magnets, sensors,
                            FMFTS_MOST_TOGETHER, FMFTS_SENSORS);
    }
    if (!fmfts_have_doubles(b, wanted, ARRAYS)) {
        return NULL;
    }
    const fmfts_beside pad = {sensors,       magnets,           b[PLACES].buf,     b[DIRECTIONS].buf, b[MAGNETS].buf, b[REST].buf,
                              b[NOW].buf,    b[REST_ERROR].buf, b[COVARIANCE].buf, placement_m};
    fmfts_change_beside(&pad, b[REST_T].buf, b[CHANGE_T].buf, b[COVARIANCE_T2].buf);
    return Py_NewRef(Py_None);
}

/* posture(newest, later_s): what is known of the posture, goes_on_s, unsure_s, and why it is not known; see joints.h. */
FMFTS_FUNCTION(posture)
{
    double newest, later_s;
    fmfts_text why;
    (void)b;
    if (!PyArg_ParseTuple(args, "dd", &newest, &later_s)) {
        return NULL;
    }
    fmfts_posture known = fmfts_posture_at(newest, later_s);
    fmfts_clear(&why);
    fmfts_say_posture(known, later_s, &why);
    return Py_BuildValue("ddds", (double)known, fmfts_goes_on_s(later_s), fmfts_unsure_s(later_s), why.text);
}

static PyMethodDef methods[] = {
    FMFTS_METHOD(posture, "What is known of a hand's posture; see hand.py."),
    FMFTS_METHOD(change_beside, "What a neighbouring pad does to the field; see neighbour.py."),
    FMFTS_METHOD(see, "Where a neighbouring pad's magnets are; see neighbour.py."),
    FMFTS_METHOD(leap_us, "By how much a board's clock leapt; see push.h."),
    FMFTS_METHOD(push, "Add a frame, and align; see alignment.py."),
    {NULL, NULL, 0, NULL},
};

static const struct {
    const char *name;
    double value;
} LIMITS[] = {
    {"LONGEST_GAP_US", FMFTS_LONGEST_GAP_US},
    {"VAGUE_M", FMFTS_VAGUE_M},
    {"REACH_M", FMFTS_REACH_M},
    {"REACH_RAD", FMFTS_REACH_RAD},
    {"MOMENT_DEVIATION", FMFTS_MOMENT_DEVIATION},
    {"SILENT_S", FMFTS_SILENT_S},
    {"POSTURE_KNOWN", FMFTS_POSTURE_KNOWN},
    {"POSTURE_OUTSIDE", FMFTS_POSTURE_OUTSIDE},
    {"POSTURE_NO_REST", FMFTS_POSTURE_NO_REST},
    {"POSTURE_NO_JOINTS", FMFTS_POSTURE_NO_JOINTS},
    {"POSTURE_UNTAUGHT", FMFTS_POSTURE_UNTAUGHT},
    {"POSTURE_ANY", FMFTS_POSTURE_ANY},
};

static int set_up(PyObject *module)
{
    int failed = 0;
    for (size_t i = 0; !failed && i < sizeof LIMITS / sizeof *LIMITS; i++) {
        PyObject *value = PyFloat_FromDouble(LIMITS[i].value);
        failed = !value || PyModule_AddObjectRef(module, LIMITS[i].name, value) < 0;
        Py_XDECREF(value);
    }
    return failed ? -1 : 0;
}

FMFTS_MODULE(_alignment, methods, set_up)
