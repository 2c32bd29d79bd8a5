/* Encodes a reading as msgpack: ContactMessage of bus/messages.py. Integers and texts take as few bytes as msgpack allows,
 * as msgspec writes them. */
#include <math.h>
#include <string.h>

#include "frame.h"

#define PLUS_ONE(...) +1 /* counts what frame.h lists */
enum {
    MESSAGE_FIELDS = 27 FMFTS_TOLD_NUMBERS(PLUS_ONE), OF_SEVERAL = 3, NOW_FIELDS = 21, SLIP_FIELDS = 10,
    POSE_FIELDS = 4 FMFTS_TOLD_POSE(PLUS_ONE, PLUS_ONE), FINGER_FIELDS = 11, FORCE = 2,
};

/* msgpack's first byte of each type that a message has. */
enum {
    FIXED_MAP = 0x80, FIXED_ARRAY = 0x90, FIXED_TEXT = 0xA0, NIL = 0xC0, FALSE = 0xC2, TRUE = 0xC3, FLOAT64 = 0xCB,
    UINT8 = 0xCC, INT8 = 0xD0, /* those of two, four and eight bytes follow each */
    TEXT8 = 0xD9, TEXT16 = 0xDA, MAP16 = 0xDE,
};

/* Keys of a contact model's outputs: value and deviation, and for `now` the rates of both. */
static const char *const OUTPUT[FMFTS_CONTACT][4] = {
    {"x_m", "x_sd_m", "x_rate_m_per_s", "x_rate_sd_m_per_s"},
    {"y_m", "y_sd_m", "y_rate_m_per_s", "y_rate_sd_m_per_s"},
    {"force_n", "force_sd_n", "force_rate_n_per_s", "force_rate_sd_n_per_s"},
    {"shear_x_n", "shear_x_sd_n", "shear_x_rate_n_per_s", "shear_x_rate_sd_n_per_s"},
    {"shear_y_n", "shear_y_sd_n", "shear_y_rate_n_per_s", "shear_y_rate_sd_n_per_s"},
};

static const char *const HEALTH[FMFTS_HEALTHS] = {"ok",          "degraded", "disturbed",   "lost",
                                                  "no_baseline", "stale",    "disconnected"};

const char *fmfts_health_name(fmfts_health health)
{
    return HEALTH[health];
}

/* room: size of `bytes`; 0: only is_finite is wanted, whether all numbers so far are finite. */
typedef struct {
    uint8_t *bytes;
    size_t size, room;
    bool fits, is_finite;
} fmfts_packer;

static void put_bytes(fmfts_packer *p, const void *bytes, size_t count)
{
    p->fits = p->fits && count <= p->room - p->size;
    if (p->fits) {
        memcpy(p->bytes + p->size, bytes, count);
        p->size += count;
    }
}

/* A type, and a value of `count` bytes, the highest first. */
static void put_typed(fmfts_packer *p, int type, uint64_t value, size_t count)
{
    uint8_t bytes[1 + sizeof value];
    bytes[0] = (uint8_t)type;
    for (size_t byte = count; byte > 0; byte--, value >>= 8) {
        bytes[byte] = (uint8_t)value;
    }
    put_bytes(p, bytes, 1 + count);
}

static void put_text(fmfts_packer *p, const char *text, size_t size)
{
    if (size < 32) {
        put_typed(p, FIXED_TEXT | (int)size, 0, 0);
    } else {
        put_typed(p, size < 256 ? TEXT8 : TEXT16, size, size < 256 ? 1 : 2);
    }
    put_bytes(p, text, size);
}

static void put_name(fmfts_packer *p, const char *name)
{
    if (p->room > 0) {
        put_text(p, name, strlen(name));
    }
}

/* NULL: unknown, here and below. */
static void put_words(fmfts_packer *p, const char *name, const char *words)
{
    put_name(p, name);
    if (words) {
        put_text(p, words, strlen(words));
    } else {
        put_typed(p, NIL, 0, 0);
    }
}

static void put_integer(fmfts_packer *p, const char *name, int64_t value)
{
    int wide = 0;
    put_name(p, name);
    if (-32 <= value && value < 128) {
        put_typed(p, (uint8_t)value, 0, 0);
        return;
    }
    while (wide < 3 && (value < 0 ? value < -(INT64_C(1) << ((8 << wide) - 1)) : value >> (8 << wide) != 0)) {
        wide++;
    }
    put_typed(p, (value < 0 ? INT8 : UINT8) + wide, (uint64_t)value, (size_t)1 << wide);
}

static void put_flag(fmfts_packer *p, const char *name, bool flag)
{
    put_name(p, name);
    put_typed(p, flag ? TRUE : FALSE, 0, 0);
}

static void put_float(fmfts_packer *p, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_typed(p, FLOAT64, bits, sizeof bits);
    p->is_finite = p->is_finite && isfinite(value);
}

static void put_number(fmfts_packer *p, const char *name, const double *value)
{
    put_name(p, name);
    if (value) {
        put_float(p, *value);
    } else {
        put_typed(p, NIL, 0, 0);
    }
}

static void put_vector(fmfts_packer *p, const char *name, const double vector[3])
{
    put_name(p, name);
    put_typed(p, vector ? FIXED_ARRAY | 3 : NIL, 0, 0);
    for (int i = 0; vector && i < 3; i++) {
        put_float(p, vector[i]);
    }
}

static void put_contact(fmfts_packer *p, const fmfts_reading *r)
{
    put_name(p, "contact");
    put_typed(p, r->contact == FMFTS_NOT_KNOWN ? NIL : r->contact == FMFTS_IN_CONTACT ? TRUE : FALSE, 0, 0);
    for (int i = 0; i < FMFTS_CONTACT; i++) {
        bool told = i == FORCE ? r->tells_force : r->tells_place && i < r->estimate.outputs;
        const double *value = i == FORCE ? &r->force_n : &r->estimate.place[i];
        const double *deviation = i == FORCE ? &r->force_sd_n : &r->estimate.deviation[i];
        put_number(p, OUTPUT[i][0], told ? value : NULL);
        put_number(p, OUTPUT[i][1], told ? deviation : NULL);
    }
    put_flag(p, "over_range", r->over_range);
#define PUT(flag, name) put_number(p, #name, r->flag ? &r->name : NULL);
    FMFTS_TOLD_NUMBERS(PUT)
}

/* t_ns: the time for which it holds. Without a touch only the force is valid. */
static void put_now(fmfts_packer *p, const fmfts_now *now, int64_t t_ns)
{
    const fmfts_contact_now *contact = &now->contact;
    put_name(p, "now");
    if (!now->known) {
        put_typed(p, NIL, 0, 0);
        return;
    }
    put_typed(p, MAP16, NOW_FIELDS, 2);
    put_integer(p, "t_ns", t_ns);
    for (int i = 0; i < FMFTS_CONTACT; i++) {
        bool told = i == FORCE || (now->places && i < contact->outputs);
        const double *number[4] = {&contact->value[i], &contact->deviation[i], &contact->rate[i], &contact->rate_deviation[i]};
        for (int k = 0; k < 4; k++) {
            put_number(p, OUTPUT[i][k], told ? number[k] : NULL);
        }
    }
}

/* The map is present if and only if `slip` is configured. */
static void put_slip(fmfts_packer *p, const fmfts_reading *r)
{
    const fmfts_slip *slip = &r->slip;
    if (!r->tells_slip) {
        return;
    }
    put_name(p, "slip");
    bool known = slip->known, knows = known && slip->knows_friction;
    put_typed(p, FIXED_MAP | SLIP_FIELDS, 0, 0);
    put_name(p, "slipping");
    put_typed(p, !known ? NIL : slip->slipping ? TRUE : FALSE, 0, 0);
    put_number(p, "sticking_probability", known ? &slip->sticking : NULL);
    put_number(p, "speed_m_per_s", known ? &slip->speed_m_per_s : NULL);
    put_number(p, "speed_sd_m_per_s", known ? &slip->speed_sd_m_per_s : NULL);
    put_number(p, "direction_rad", known ? &slip->direction_rad : NULL);
    put_number(p, "direction_sd_rad", known ? &slip->direction_sd_rad : NULL);
    put_number(p, "friction", knows ? &slip->friction : NULL);
    put_number(p, "friction_sd", knows ? &slip->friction_sd : NULL);
    put_number(p, "margin_n", knows ? &slip->margin_n : NULL);
    put_number(p, "margin_sd_n", knows ? &slip->margin_sd_n : NULL);
}

/* A list that holds few enough items, or nil. */
static void put_list(fmfts_packer *p, const char *name, bool told, size_t count)
{
    put_name(p, name);
    put_typed(p, told ? FIXED_ARRAY | (int)count : NIL, 0, 0);
}

static void put_fingers(fmfts_packer *p, const fmfts_told_several *several)
{
    put_list(p, "contacts", several->tells_fingers, several->fingers);
    for (size_t f = 0; several->tells_fingers && f < several->fingers; f++) {
        const fmfts_told_finger *finger = &several->finger[f];
        put_typed(p, FIXED_MAP | FINGER_FIELDS, 0, 0);
        put_integer(p, "id", finger->id);
        for (int i = 0; i < FMFTS_CONTACT; i++) {
            put_number(p, OUTPUT[i][0], i < finger->outputs ? &finger->value[i] : NULL);
            put_number(p, OUTPUT[i][1], i < finger->outputs ? &finger->deviation[i] : NULL);
        }
    }
    put_flag(p, "more", several->more);
}

static void put_magnet(fmfts_packer *p, const fmfts_reading *r, const fmfts_told_pose *pose)
{
    bool has_ambient = !isnan(r->ambient_t[0]);
    put_typed(p, FIXED_MAP | POSE_FIELDS, 0, 0);
#define PUT_ONE(type, name) put_number(p, #name, &pose->name);
#define PUT_MANY(type, name, count) put_vector(p, #name, pose->name);
    FMFTS_TOLD_POSE(PUT_ONE, PUT_MANY)
    put_vector(p, "ambient_t", has_ambient ? r->ambient_t : NULL);
    put_vector(p, "ambient_sd_t", has_ambient ? r->ambient_sd_t : NULL);
    put_number(p, "residual_t", &r->residual_t);
    put_number(p, "chi2", &r->chi2);
}

static void put_poses(fmfts_packer *p, const fmfts_reading *r)
{
    const fmfts_told_several *several = r->several;
    put_name(p, "pose");
    if (several || !r->tells_pose) {
        put_typed(p, NIL, 0, 0);
    } else {
        put_magnet(p, r, &r->pose);
    }
    if (several) {
        put_list(p, "poses", several->tells_poses, several->magnets);
    }
    for (size_t m = 0; several && several->tells_poses && m < several->magnets; m++) {
        put_magnet(p, r, &several->pose[m]);
    }
}

static void put_reading(fmfts_packer *p, const fmfts_reading *r, int64_t now_ns)
{
    put_number(p, "temperature_c", isnan(r->temperature_c) ? NULL : &r->temperature_c);
    put_words(p, "health", HEALTH[r->health]);
    put_name(p, "reason");
    put_text(p, r->reason.text, r->reason.size);
    put_contact(p, r);
    if (r->several) {
        put_fingers(p, r->several);
    }
    put_now(p, &r->now, now_ns);
    put_slip(p, r);
    put_poses(p, r);
    put_integer(p, "sensors_ok", r->sensors_ok);
}

size_t fmfts_write_message(const fmfts_words *words, const fmfts_reading *reading, int64_t number, const fmfts_times *times,
                           uint8_t message[FMFTS_MESSAGE_ROOM])
{
    fmfts_packer packer = {.bytes = message, .room = FMFTS_MESSAGE_ROOM, .fits = true}, *p = &packer;
    put_typed(p, MAP16, MESSAGE_FIELDS + (reading->several ? OF_SEVERAL : 0) + (reading->tells_slip ? 1 : 0), 2);
    put_integer(p, "v", words->version);
    put_words(p, "pad", words->pad);
    put_words(p, "boot", words->boot);
    put_integer(p, "seq", number);
    put_integer(p, "t_sample_ns", times->sampled);
    put_integer(p, "t_publish_ns", times->published);
    put_integer(p, "utc_ns", times->utc);
    put_reading(p, reading, times->now);
    put_words(p, "model", words->model);
    put_words(p, "baseline", words->baseline);
    return p->fits ? p->size : 0;
}

bool fmfts_is_finite(const fmfts_reading *reading)
{
    fmfts_packer packer = {.is_finite = true};
    put_reading(&packer, reading, 0);
    return packer.is_finite;
}
