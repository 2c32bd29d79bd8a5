/* The client in five parts: msgpack, the schema, where the daemon is and who may listen, the client, why it hears nothing. */
#define _GNU_SOURCE
#include "fmfts.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <pwd.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>

/* Copies a text of `size` bytes, cut between characters if it is too long. */
static void copy_text(char into[FMFTS_TEXT_SIZE], const void *text, size_t size)
{
    if (size >= FMFTS_TEXT_SIZE) {
        size = FMFTS_TEXT_SIZE - 1;
        while (size > 0 && (((const uint8_t *)text)[size] & 0xC0) == 0x80)
            size--;
    }
    memcpy(into, text, size);
    into[size] = 0;
}

__attribute__((format(printf, 2, 3))) static bool fail(char why[FMFTS_TEXT_SIZE], const char *format, ...)
{
    char whole[FMFTS_TEXT_SIZE + 1]; /* shows whether a cut would lie within a character */
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(whole, sizeof whole, format, arguments);
    va_end(arguments);
    copy_text(why, whole, strlen(whole));
    return false;
}

/* ---- msgpack (https://github.com/msgpack/msgpack/blob/master/spec.md): one head at a time ---- */

enum type { NEVER, NIL, BOOLEAN, UNSIGNED, SIGNED, FLOAT, TEXT, BYTES, EXTENSION, ARRAY, MAP };

struct reader {
    const uint8_t *at, *end;
};

struct item {
    enum type type;
    uint64_t bits; /* an integer; a boolean as 0 or 1; otherwise the number of bytes, elements or pairs that follow */
    double number;
    const uint8_t *bytes; /* of TEXT, BYTES and EXTENSION */
};

static uint64_t big_endian(const uint8_t *bytes, size_t count)
{
    uint64_t value = 0;
    for (size_t i = 0; i < count; i++)
        value = value << 8 | bytes[i];
    return value;
}

static double float_of(uint64_t bits, size_t width)
{
    if (width == 8) {
        double value;
        memcpy(&value, &bits, sizeof value);
        return value;
    }
    uint32_t half = (uint32_t)bits;
    float value;
    memcpy(&value, &half, sizeof value);
    return (double)value;
}

/* The heads 0xC0 to 0xDF. `width`: bytes of the number that follows the head. */
static const struct {
    uint8_t type, width;
} heads[32] = {
    {NIL, 0},       {NEVER, 0},     {BOOLEAN, 0},   {BOOLEAN, 0},   {BYTES, 1},     {BYTES, 2},    {BYTES, 4},
    {EXTENSION, 1}, {EXTENSION, 2}, {EXTENSION, 4}, {FLOAT, 4},     {FLOAT, 8},     {UNSIGNED, 1}, {UNSIGNED, 2},
    {UNSIGNED, 4},  {UNSIGNED, 8},  {SIGNED, 1},    {SIGNED, 2},    {SIGNED, 4},    {SIGNED, 8},   {EXTENSION, 0},
    {EXTENSION, 0}, {EXTENSION, 0}, {EXTENSION, 0}, {EXTENSION, 0}, {TEXT, 1},      {TEXT, 2},     {TEXT, 4},
    {ARRAY, 2},     {ARRAY, 4},     {MAP, 2},       {MAP, 4},
};

static void read_short(uint8_t head, struct item *item)
{
    if (head < 0x80)
        *item = (struct item){.type = UNSIGNED, .bits = head};
    else if (head >= 0xE0)
        *item = (struct item){.type = SIGNED, .bits = (uint64_t)(int64_t)(head - 0x100)};
    else if (head < 0x90)
        *item = (struct item){.type = MAP, .bits = head & 15U};
    else if (head < 0xA0)
        *item = (struct item){.type = ARRAY, .bits = head & 15U};
    else
        *item = (struct item){.type = TEXT, .bits = head & 31U};
}

static bool read_long(struct reader *reader, uint8_t head, struct item *item)
{
    size_t width = heads[head & 31].width;
    if ((size_t)(reader->end - reader->at) < width)
        return false;
    *item = (struct item){.type = (enum type)heads[head & 31].type, .bits = big_endian(reader->at, width)};
    reader->at += width;
    if (item->type == BOOLEAN)
        item->bits = head & 1;
    else if (item->type == SIGNED && width < 8 && item->bits >> (8 * width - 1))
        item->bits |= UINT64_MAX << (8 * width);
    else if (item->type == FLOAT)
        item->number = float_of(item->bits, width);
    else if (item->type == EXTENSION)
        item->bits = 1 + (width ? item->bits : 1U << (head - 0xD4)); /* 1: the byte with the extension's type */
    return item->type != NEVER;
}

/* RFC 3629: the shortest form, no surrogates, at most U+10FFFF. */
static bool is_utf8(const uint8_t *at, const uint8_t *end)
{
    while (at < end) {
        uint8_t lead = *at++;
        if (lead < 0x80)
            continue;
        int more = lead >= 0xF0 ? 3 : lead >= 0xE0 ? 2 : 1;
        uint8_t low = lead == 0xE0 ? 0xA0 : lead == 0xF0 ? 0x90 : 0x80;
        uint8_t high = lead == 0xED ? 0x9F : lead == 0xF4 ? 0x8F : 0xBF;
        if (lead < 0xC2 || lead > 0xF4 || end - at < more || *at < low || *at > high)
            return false;
        for (at++; --more > 0; at++)
            if ((*at & 0xC0) != 0x80)
                return false;
    }
    return true;
}

/* Reads the next item; for an array or a map only its head. False: the message is cut off, or no msgpack. */
static bool read_item(struct reader *reader, struct item *item)
{
    if (reader->at == reader->end)
        return false;
    uint8_t head = *reader->at++;
    if (head < 0xC0 || head >= 0xE0)
        read_short(head, item);
    else if (!read_long(reader, head, item))
        return false;
    if (item->type == UNSIGNED || item->type == SIGNED)
        item->number = item->type == SIGNED ? (double)(int64_t)item->bits : (double)item->bits;
    if (item->type < TEXT)
        return true;
    /* Each byte, element or pair takes at least one byte, so there cannot be more of them than bytes left. */
    if (item->bits > (uint64_t)(reader->end - reader->at))
        return false;
    if (item->type <= EXTENSION) {
        item->bytes = reader->at;
        reader->at += item->bits;
    }
    return item->type != TEXT || is_utf8(item->bytes, reader->at);
}

/* Skips one value with everything in it, at any depth. */
static bool skip(struct reader *reader)
{
    for (uint64_t left = 1; left > 0; left--) {
        struct item item;
        if (!read_item(reader, &item))
            return false;
        if (item.type == ARRAY || item.type == MAP)
            left += item.type == MAP ? 2 * item.bits : item.bits;
        if (left > 1 + (uint64_t)(reader->end - reader->at))
            return false;
    }
    return true;
}

static bool is_text(const struct item *item, const char *text)
{
    return item->type == TEXT && item->bits == strlen(text) && memcmp(item->bytes, text, item->bits) == 0;
}

/* ---- the schema: docs/messages.md ---- */

enum kind { INTEGER, NUMBER, FLAG, TOUCH, HEALTH, SENTENCE, WORD, VECTOR, POSE, NOW, SLIP, FINGERS, POSES };

enum { ALWAYS = -1 }; /* instead of an offset of `known`: the value must not be null */

struct field {
    const char *name;
    enum kind kind;
    ptrdiff_t known;
    size_t value;
    bool may_be_missing; /* absent from older daemons, and for some pads */
};

#define FIELD(kind, of, name) {#name, kind, ALWAYS, offsetof(struct of, name), false}
#define NULLABLE(kind, of, name) {#name, kind, offsetof(struct of, name.known), offsetof(struct of, name.value), false}

static const struct field pose_fields[] = {
    FIELD(VECTOR, fmfts_pose, position_m),
    FIELD(VECTOR, fmfts_pose, position_sd_m),
    FIELD(VECTOR, fmfts_pose, axis),
    FIELD(NUMBER, fmfts_pose, axis_sd_rad),
    FIELD(NUMBER, fmfts_pose, remanence_t),
    FIELD(NUMBER, fmfts_pose, remanence_sd_t),
    NULLABLE(VECTOR, fmfts_pose, ambient_t),
    NULLABLE(VECTOR, fmfts_pose, ambient_sd_t),
    FIELD(NUMBER, fmfts_pose, residual_t),
    FIELD(NUMBER, fmfts_pose, chi2),
};

static const struct field finger_fields[] = {
    FIELD(INTEGER, fmfts_finger, id),
    FIELD(NUMBER, fmfts_finger, x_m),
    FIELD(NUMBER, fmfts_finger, x_sd_m),
    FIELD(NUMBER, fmfts_finger, y_m),
    FIELD(NUMBER, fmfts_finger, y_sd_m),
    FIELD(NUMBER, fmfts_finger, force_n),
    FIELD(NUMBER, fmfts_finger, force_sd_n),
    NULLABLE(NUMBER, fmfts_finger, shear_x_n),
    NULLABLE(NUMBER, fmfts_finger, shear_x_sd_n),
    NULLABLE(NUMBER, fmfts_finger, shear_y_n),
    NULLABLE(NUMBER, fmfts_finger, shear_y_sd_n),
};

static const struct field now_fields[] = {
    FIELD(INTEGER, fmfts_now, t_ns),
    NULLABLE(NUMBER, fmfts_now, x_m),
    NULLABLE(NUMBER, fmfts_now, x_sd_m),
    NULLABLE(NUMBER, fmfts_now, x_rate_m_per_s),
    NULLABLE(NUMBER, fmfts_now, x_rate_sd_m_per_s),
    NULLABLE(NUMBER, fmfts_now, y_m),
    NULLABLE(NUMBER, fmfts_now, y_sd_m),
    NULLABLE(NUMBER, fmfts_now, y_rate_m_per_s),
    NULLABLE(NUMBER, fmfts_now, y_rate_sd_m_per_s),
    NULLABLE(NUMBER, fmfts_now, force_n),
    NULLABLE(NUMBER, fmfts_now, force_sd_n),
    NULLABLE(NUMBER, fmfts_now, force_rate_n_per_s),
    NULLABLE(NUMBER, fmfts_now, force_rate_sd_n_per_s),
    NULLABLE(NUMBER, fmfts_now, shear_x_n),
    NULLABLE(NUMBER, fmfts_now, shear_x_sd_n),
    NULLABLE(NUMBER, fmfts_now, shear_x_rate_n_per_s),
    NULLABLE(NUMBER, fmfts_now, shear_x_rate_sd_n_per_s),
    NULLABLE(NUMBER, fmfts_now, shear_y_n),
    NULLABLE(NUMBER, fmfts_now, shear_y_sd_n),
    NULLABLE(NUMBER, fmfts_now, shear_y_rate_n_per_s),
    NULLABLE(NUMBER, fmfts_now, shear_y_rate_sd_n_per_s),
};

static const struct field slip_fields[] = {
    NULLABLE(FLAG, fmfts_slip, slipping),
    NULLABLE(NUMBER, fmfts_slip, sticking_probability),
    NULLABLE(NUMBER, fmfts_slip, speed_m_per_s),
    NULLABLE(NUMBER, fmfts_slip, speed_sd_m_per_s),
    NULLABLE(NUMBER, fmfts_slip, direction_rad),
    NULLABLE(NUMBER, fmfts_slip, direction_sd_rad),
    NULLABLE(NUMBER, fmfts_slip, friction),
    NULLABLE(NUMBER, fmfts_slip, friction_sd),
    NULLABLE(NUMBER, fmfts_slip, margin_n),
    NULLABLE(NUMBER, fmfts_slip, margin_sd_n),
};

/* In the order in which the daemon sends them, so that finding a key takes one comparison. */
static const struct field contact_fields[] = {
    FIELD(WORD, fmfts_contact, pad),
    FIELD(WORD, fmfts_contact, boot),
    FIELD(INTEGER, fmfts_contact, seq),
    FIELD(INTEGER, fmfts_contact, t_sample_ns),
    FIELD(INTEGER, fmfts_contact, t_publish_ns),
    FIELD(INTEGER, fmfts_contact, utc_ns),
    NULLABLE(NUMBER, fmfts_contact, temperature_c),
    FIELD(HEALTH, fmfts_contact, health),
    FIELD(SENTENCE, fmfts_contact, reason),
    FIELD(TOUCH, fmfts_contact, contact),
    NULLABLE(NUMBER, fmfts_contact, x_m),
    NULLABLE(NUMBER, fmfts_contact, x_sd_m),
    NULLABLE(NUMBER, fmfts_contact, y_m),
    NULLABLE(NUMBER, fmfts_contact, y_sd_m),
    NULLABLE(NUMBER, fmfts_contact, force_n),
    NULLABLE(NUMBER, fmfts_contact, force_sd_n),
    NULLABLE(NUMBER, fmfts_contact, shear_x_n),
    NULLABLE(NUMBER, fmfts_contact, shear_x_sd_n),
    NULLABLE(NUMBER, fmfts_contact, shear_y_n),
    NULLABLE(NUMBER, fmfts_contact, shear_y_sd_n),
    FIELD(FLAG, fmfts_contact, over_range),
    NULLABLE(NUMBER, fmfts_contact, force_min_n),
    NULLABLE(NUMBER, fmfts_contact, displacement_m),
    NULLABLE(NUMBER, fmfts_contact, displacement_sd_m),
    {"contacts", FINGERS, offsetof(struct fmfts_contact, contacts.known), offsetof(struct fmfts_contact, contacts), true},
    {"more", FLAG, offsetof(struct fmfts_contact, more.known), offsetof(struct fmfts_contact, more.value), true},
    {"now", NOW, offsetof(struct fmfts_contact, now.known), offsetof(struct fmfts_contact, now), true},
    {"slip", SLIP, offsetof(struct fmfts_contact, slip.known), offsetof(struct fmfts_contact, slip), true},
    {"pose", POSE, offsetof(struct fmfts_contact, pose.known), offsetof(struct fmfts_contact, pose), false},
    {"poses", POSES, offsetof(struct fmfts_contact, poses.known), offsetof(struct fmfts_contact, poses), true},
    FIELD(INTEGER, fmfts_contact, sensors_ok),
    FIELD(WORD, fmfts_contact, model),
    NULLABLE(WORD, fmfts_contact, baseline),
};

enum {
    POSE_COUNT = sizeof pose_fields / sizeof *pose_fields,
    FINGER_COUNT = sizeof finger_fields / sizeof *finger_fields,
    NOW_COUNT = sizeof now_fields / sizeof *now_fields,
    SLIP_COUNT = sizeof slip_fields / sizeof *slip_fields,
    CONTACT_COUNT = sizeof contact_fields / sizeof *contact_fields
};

static const char *const health_names[] = {"unknown", "ok",    "degraded",     "disturbed",
                                           "lost",    "stale", "disconnected", "no_baseline"};
enum { HEALTHS = sizeof health_names / sizeof *health_names };

const char *fmfts_health_name(enum fmfts_health health)
{
    return health_names[(unsigned)health < HEALTHS ? health : 0];
}

static bool read_number(const struct item *item, double *number)
{
    *number = item->number;
    return (item->type == FLOAT || item->type == UNSIGNED || item->type == SIGNED) && isfinite(item->number);
}

static bool read_integer(const struct item *item, int64_t *integer)
{
    *integer = (int64_t)item->bits;
    return item->type == SIGNED ? true : item->type == UNSIGNED && item->bits <= INT64_MAX;
}

static bool read_vector(struct reader *reader, const struct item *item, double vector[3])
{
    if (item->type != ARRAY || item->bits != 3)
        return false;
    for (int i = 0; i < 3; i++) {
        struct item component;
        if (!read_item(reader, &component) || !read_number(&component, &vector[i]))
            return false;
    }
    return true;
}

static bool read_word(const struct item *item, char word[FMFTS_WORD_SIZE])
{
    if (item->type != TEXT || item->bits >= FMFTS_WORD_SIZE || memchr(item->bytes, 0, item->bits))
        return false;
    memcpy(word, item->bytes, item->bits);
    word[item->bits] = 0;
    return true;
}

static bool read_sentence(const struct item *item, char sentence[FMFTS_TEXT_SIZE])
{
    if (item->type != TEXT)
        return false;
    copy_text(sentence, item->bytes, item->bits);
    return true;
}

static bool read_health(const struct item *item, enum fmfts_health *health)
{
    *health = FMFTS_HEALTH_UNKNOWN;
    for (int i = 1; i < HEALTHS; i++)
        if (is_text(item, health_names[i]))
            *health = (enum fmfts_health)i;
    return item->type == TEXT;
}

static bool read_flag(const struct item *item, bool *flag)
{
    *flag = item->type == BOOLEAN && item->bits;
    return item->type == BOOLEAN;
}

static bool read_touch(const struct item *item, enum fmfts_touch *touch)
{
    bool touched;
    bool known = read_flag(item, &touched);
    *touch = !known ? FMFTS_TOUCH_UNKNOWN : touched ? FMFTS_TOUCHED : FMFTS_UNTOUCHED;
    return known || item->type == NIL;
}

static void set_all_unknown(const struct field *fields, int count, char *into);

/* Sets the numbers of an unknown value to NaN, so that nobody uses them by mistake. */
static void set_unknown(enum kind kind, char *value)
{
    int numbers = kind == NUMBER ? 1 : kind == VECTOR ? 3 : 0;
    for (int i = 0; i < numbers; i++)
        ((double *)(void *)value)[i] = NAN;
    if (kind == POSE)
        set_all_unknown(pose_fields, POSE_COUNT, value);
    if (kind == NOW)
        set_all_unknown(now_fields, NOW_COUNT, value);
    if (kind == SLIP) {
        memset(value, 0, sizeof(struct fmfts_slip));
        set_all_unknown(slip_fields, SLIP_COUNT, value);
    }
    if (kind == FINGERS) {
        struct fmfts_fingers *fingers = (void *)value;
        memset(fingers, 0, sizeof *fingers);
        for (int i = 0; i < FMFTS_MAX_FINGERS; i++)
            set_all_unknown(finger_fields, FINGER_COUNT, (char *)&fingers->finger[i]);
    }
    if (kind == POSES) {
        struct fmfts_poses *poses = (void *)value;
        memset(poses, 0, sizeof *poses);
        for (int i = 0; i < FMFTS_MAX_MAGNETS; i++)
            set_all_unknown(pose_fields, POSE_COUNT, (char *)&poses->pose[i]);
    }
}

static void set_all_unknown(const struct field *fields, int count, char *into)
{
    for (int i = 0; i < count; i++)
        set_unknown(fields[i].kind, into + fields[i].value);
}

static bool read_map(struct reader *reader, const struct item *map, const struct field *fields, int count, void *into,
                     char why[FMFTS_TEXT_SIZE]);

static bool read_pose(struct reader *reader, const struct item *item, struct fmfts_pose *pose,
                      char why[FMFTS_TEXT_SIZE])
{
    bool read = read_map(reader, item, pose_fields, POSE_COUNT, pose, why);
    pose->known = read;
    return read;
}

/* The daemon may not know a place, but it always knows force and its rate. */
static bool read_now(struct reader *reader, const struct item *item, struct fmfts_now *now, char why[FMFTS_TEXT_SIZE])
{
    now->known = read_map(reader, item, now_fields, NOW_COUNT, now, why);
    if (!now->known)
        return false;
    bool told = now->force_n.known && now->force_sd_n.known && now->force_rate_n_per_s.known &&
                now->force_rate_sd_n_per_s.known;
    return told || fail(why, "now.force_n is not a finite number");
}

/* Fingers beyond FMFTS_MAX_FINGERS must be valid, too, but are dropped. */
static bool read_fingers(struct reader *reader, const struct item *list, struct fmfts_fingers *fingers,
                         char why[FMFTS_TEXT_SIZE])
{
    set_unknown(FINGERS, (char *)fingers);
    if (list->type != ARRAY)
        return false;
    for (uint64_t left = list->bits; left > 0; left--) {
        struct item map;
        struct fmfts_finger spare;
        bool has_place = fingers->count < FMFTS_MAX_FINGERS;
        struct fmfts_finger *finger = has_place ? &fingers->finger[fingers->count] : &spare;
        if (!read_item(reader, &map) || !read_map(reader, &map, finger_fields, FINGER_COUNT, finger, why))
            return false;
        fingers->count += has_place;
    }
    return true;
}

static bool read_poses(struct reader *reader, const struct item *list, struct fmfts_poses *poses,
                       char why[FMFTS_TEXT_SIZE])
{
    set_unknown(POSES, (char *)poses);
    if (list->type != ARRAY)
        return false;
    for (uint64_t left = list->bits; left > 0; left--) {
        struct item map;
        struct fmfts_pose spare;
        bool has_place = poses->count < FMFTS_MAX_MAGNETS;
        if (!read_item(reader, &map) || !read_pose(reader, &map, has_place ? &poses->pose[poses->count] : &spare, why))
            return false;
        poses->count += has_place;
    }
    return true;
}

static bool read_value(struct reader *reader, const struct item *item, enum kind kind, void *value,
                       char why[FMFTS_TEXT_SIZE])
{
    switch (kind) {
    case INTEGER:
        return read_integer(item, value);
    case NUMBER:
        return read_number(item, value);
    case FLAG:
        return read_flag(item, value);
    case TOUCH:
        return read_touch(item, value);
    case HEALTH:
        return read_health(item, value);
    case SENTENCE:
        return read_sentence(item, value);
    case WORD:
        return read_word(item, value);
    case VECTOR:
        return read_vector(reader, item, value);
    case POSE:
        return read_pose(reader, item, value, why);
    case NOW:
        return read_now(reader, item, value, why);
    case SLIP:
        return read_map(reader, item, slip_fields, SLIP_COUNT, value, why);
    case FINGERS:
        return read_fingers(reader, item, value, why);
    case POSES:
        return read_poses(reader, item, value, why);
    }
    return false;
}

static bool read_field(struct reader *reader, const struct field *field, char *into, char why[FMFTS_TEXT_SIZE])
{
    static const char *const wanted[] = {
        "an integer of 64 bits", "a finite number",       "true or false", "true, false or null", "text", "text",
        "text of 64 bytes",      "three finite numbers", "a map", "a map", "a map", "a list of maps", "a list of maps"};
    struct item item;
    if (!read_item(reader, &item))
        return fail(why, "cut off, or no msgpack, at %s", field->name);
    bool known = field->known == ALWAYS || item.type != NIL;
    if (known && !read_value(reader, &item, field->kind, into + field->value, why))
        return *why ? false : fail(why, "%s is not %s", field->name, wanted[field->kind]);
    if (!known)
        set_unknown(field->kind, into + field->value);
    if (field->known != ALWAYS)
        *(bool *)(into + field->known) = known;
    return true;
}

/* The index of `key` in `fields`, searched from `expected` on; `count` if it is not there. */
static int find(const struct item *key, const struct field *fields, int count, int expected)
{
    for (int i = 0; i < count; i++) {
        int index = (expected + i) % count;
        if (is_text(key, fields[index].name))
            return index;
    }
    return count;
}

static bool read_map(struct reader *reader, const struct item *map, const struct field *fields, int count, void *into,
                     char why[FMFTS_TEXT_SIZE])
{
    if (map->type != MAP)
        return false;
    uint64_t seen = 0;
    int expected = 0;
    for (uint64_t left = map->bits; left > 0; left--) {
        struct item key;
        if (!read_item(reader, &key) || key.type != TEXT)
            return fail(why, "cut off, or no msgpack map with text as keys");
        int index = find(&key, fields, count, expected);
        if (index == count) {
            if (!skip(reader))
                return fail(why, "cut off, or no msgpack");
            continue;
        }
        if (!read_field(reader, &fields[index], into, why))
            return false;
        seen |= UINT64_C(1) << index;
        expected = index + 1;
    }
    for (int i = 0; i < count; i++)
        if (!(seen >> i & 1) && !fields[i].may_be_missing)
            return fail(why, "%s is missing", fields[i].name);
    return true;
}

/* Checked first: in another version all other keys may have another meaning. `reader` is after the map's head. */
static enum fmfts_result check_version(struct reader reader, uint64_t pairs, char why[FMFTS_TEXT_SIZE])
{
    struct item version = {.type = NIL};
    for (; pairs > 0; pairs--) {
        struct item key, value;
        if (!read_item(&reader, &key))
            break;
        struct reader at_value = reader;
        if (!skip(&reader))
            break;
        if (is_text(&key, "v") && read_item(&at_value, &value))
            version = value;
    }
    if (pairs > 0 || reader.at != reader.end) {
        fail(why, "cut off, or no msgpack, or more than one message in one");
        return FMFTS_REFUSED;
    }
    if (version.type == UNSIGNED && version.bits == FMFTS_SCHEMA_VERSION)
        return FMFTS_NEW;
    if (version.type == UNSIGNED)
        fail(why, "the daemon sends schema version %.17g, this client reads %d: build it with the daemon's own fmfts.c",
             version.number, FMFTS_SCHEMA_VERSION);
    else
        fail(why, "the daemon names no schema version, this client reads %d", FMFTS_SCHEMA_VERSION);
    return FMFTS_WRONG_VERSION;
}

enum fmfts_result fmfts_decode(const void *body, size_t size, struct fmfts_contact *contact, char why[FMFTS_TEXT_SIZE])
{
    struct reader reader = {body, (const uint8_t *)body + size};
    struct item map;
    *why = 0;
    if (!read_item(&reader, &map) || map.type != MAP) {
        fail(why, "not a msgpack map");
        return FMFTS_REFUSED;
    }
    enum fmfts_result version = check_version(reader, map.bits, why);
    if (version != FMFTS_NEW)
        return version;
    struct fmfts_contact read;
    memset(&read, 0, sizeof read);
    set_unknown(NOW, (char *)&read.now);
    set_unknown(SLIP, (char *)&read.slip);
    set_unknown(FINGERS, (char *)&read.contacts);
    set_unknown(POSES, (char *)&read.poses);
    if (!read_map(&reader, &map, contact_fields, CONTACT_COUNT, &read, why))
        return FMFTS_REFUSED;
    read.clock_ahead_s.known = true;
    *contact = read;
    return FMFTS_NEW;
}

/* ---- where the daemon is, and who may listen: as clients/python/fmfts_client does it ---- */

enum {
    LONGEST_SOCKET_PATH = 107, /* sockaddr_un.sun_path holds 108 bytes with the closing zero */
    ENDPOINT_SIZE = 320,
    KEY_SIZE = 41, /* 32 bytes in Z85 (RFC 32), and the closing zero */
    LARGEST_KEY_FILE = 4096
};

static bool starts_with(const char *text, const char *start)
{
    return strncmp(text, start, strlen(start)) == 0;
}

static const char *named(const char *variable)
{
    const char *value = getenv(variable);
    return value && *value ? value : NULL;
}

static bool is_directory(const char *path)
{
    struct stat found;
    return stat(path, &found) == 0 && S_ISDIR(found.st_mode);
}

static bool bus_in(const char *directory, char endpoint[ENDPOINT_SIZE], char why[FMFTS_TEXT_SIZE])
{
    if (strlen(directory) + strlen("/control") > LONGEST_SOCKET_PATH)
        return fail(why, "%.120s… is too long for a socket: choose a shorter directory with FMFTS_BUS", directory);
    snprintf(endpoint, ENDPOINT_SIZE, "ipc://%s/bus", directory);
    return true;
}

/* Cuts the last name off an absolute path; false at the root. */
static bool go_up(char *path)
{
    char *slash = strrchr(path, '/');
    if (path[1] == 0)
        return false;
    slash[slash == path] = 0;
    return true;
}

/* Users whose sockets are trusted in any folder: this one, root, and the service's. */
static bool is_trusted(uid_t owner)
{
    char text[4096];
    struct passwd entry, *service = NULL;
    return owner == getuid() || owner == 0 ||
           (getpwnam_r("fmfts", &entry, text, sizeof text, &service) == 0 && service && service->pw_uid == owner);
}

/* False, with the reason in `why`, if an untrusted user made the folder, or one above it, where any user may. */
static bool is_of_trusted_users(const char *folder, char why[FMFTS_TEXT_SIZE])
{
    char path[PATH_MAX], place[PATH_MAX];
    struct stat found, above;
    for (snprintf(place, sizeof place, "%s", folder);;) {
        memcpy(path, place, sizeof path);
        if (!go_up(place))
            return true;
        if (lstat(path, &found) != 0 || stat(place, &above) != 0)
            return fail(why, "cannot see whose %.120s is: %s", path, strerror(errno));
        if (above.st_mode & S_IWOTH && !is_trusted(found.st_uid))
            return fail(why, "%.60s belongs to user %u, and any user may make such a folder in %.40s: its owner could "
                             "send false forces. Name one that is yours, root's or the service's", path,
                        (unsigned)found.st_uid, place);
    }
}

/* False, with the reason in `why`, if an untrusted user could put a socket into a named folder. The user may mean a folder
 * of another user. But in a shared place like /tmp the name does not show who owns the folder. */
static bool is_guarded(const char *directory, char why[FMFTS_TEXT_SIZE])
{
    char nearest[LONGEST_SOCKET_PATH + 1], resolved[PATH_MAX];
    struct stat found;
    snprintf(nearest, sizeof nearest, "%s", directory);
    while (stat(nearest, &found) != 0) {
        if (lstat(nearest, &found) == 0)
            return fail(why, "%.120s leads to no folder that you can see: start the daemon first", nearest);
        if (!go_up(nearest))
            return fail(why, "cannot see the folder %.120s", directory);
    }
    if (found.st_mode & S_IWOTH && strcmp(nearest, directory) == 0)
        return fail(why, "%.80s may be written to by every user: any of them could send false forces through it. Name "
                         "a folder inside it that is yours alone (mkdir -m 700)%s", directory,
                    found.st_mode & S_ISVTX ? "" : ", or chmod o-w it");
    if (found.st_mode & S_IWOTH)
        return fail(why, "%.80s is not there, and any user may make it in %.40s and send false forces: start the daemon "
                         "first, or name a folder in your home", directory, nearest);
    if (!realpath(nearest, resolved))
        return fail(why, "cannot see where %.120s leads: %s", nearest, strerror(errno));
    return is_of_trusted_users(nearest, why) && is_of_trusted_users(resolved, why);
}

static bool bus_of(const char *base, char endpoint[ENDPOINT_SIZE], char why[FMFTS_TEXT_SIZE])
{
    if (starts_with(base, "ipc:///")) {
        const char *directory = base + strlen("ipc://");
        char parent[LONGEST_SOCKET_PATH + 1];
        struct stat found;
        if (strlen(directory) < sizeof parent && stat(directory, &found) == 0 && S_ISSOCK(found.st_mode)) {
            /* …/bus, as `listen` prints it */
            snprintf(parent, sizeof parent, "%s", directory);
            *strrchr(parent, '/') = 0;
            directory = parent;
        }
        return bus_in(directory, endpoint, why) && is_guarded(directory, why);
    }
    const char *colon = strrchr(base, ':');
    if (starts_with(base, "tcp://") && colon > base + strlen("tcp://") && strlen(base) < ENDPOINT_SIZE) {
        const char *port = colon + 1;
        size_t digits = strspn(port, "0123456789");
        long number = strtol(port, NULL, 10);
        if (digits > 0 && port[digits] == 0 && number > 0 && number <= 65532) {
            snprintf(endpoint, ENDPOINT_SIZE, "%s", base);
            return true;
        }
    }
    return fail(why, "'%.100s' is no base: give ipc:///absolute/directory or tcp://host:port (at most 65532)", base);
}

static const char *temporary_directory(void)
{
    static const char *const variables[] = {"TMPDIR", "TEMP", "TMP"};
    for (int i = 0; i < 3; i++) {
        const char *value = named(variables[i]);
        if (value && is_directory(value) && access(value, W_OK | X_OK) == 0)
            return value;
    }
    return "/tmp";
}

/* The user's own directory for the bus: made with mode 0700, and refused if others may write to it. Whoever can place a
 * socket there can send any force to a robot. */
static bool own_bus(char endpoint[ENDPOINT_SIZE], char why[FMFTS_TEXT_SIZE])
{
    char directory[ENDPOINT_SIZE];
    const char *runtime = named("XDG_RUNTIME_DIR");
    if (runtime && is_directory(runtime))
        snprintf(directory, sizeof directory, "%s/fmfts", runtime);
    else
        snprintf(directory, sizeof directory, "%s/fmfts-%u", temporary_directory(), (unsigned)getuid());
    struct stat found;
    if ((mkdir(directory, 0700) != 0 && errno != EEXIST) || lstat(directory, &found) != 0)
        return fail(why, "cannot use %.120s for the bus (%s): set FMFTS_BUS", directory, strerror(errno));
    if (!S_ISDIR(found.st_mode) || found.st_uid != getuid() || found.st_mode & 077)
        return fail(why, "%.120s is not a directory of yours alone: somebody could feed false forces through it. "
                         "Remove it, or set FMFTS_BUS", directory);
    return bus_in(directory, endpoint, why);
}

static bool find_bus(const char *base, char endpoint[ENDPOINT_SIZE], char why[FMFTS_TEXT_SIZE])
{
    if (!base || !*base)
        base = named("FMFTS_BUS");
    if (base)
        return bus_of(base, endpoint, why);
    if (!is_directory("/run/fmfts"))
        return own_bus(endpoint, why);
    if (access("/run/fmfts", X_OK) != 0)
        return fail(why, "the service's /run/fmfts is closed to you: join its group (sudo usermod -aG fmfts $USER, "
                         "then log in again), or name another daemon with FMFTS_BUS");
    return bus_in("/run/fmfts", endpoint, why);
}

static bool is_loopback(const char *tcp)
{
    char host[ENDPOINT_SIZE];
    snprintf(host, sizeof host, "%s", tcp + strlen("tcp://"));
    *strrchr(host, ':') = 0;
    if (host[0] == '[' && host[strlen(host) - 1] == ']') {
        host[strlen(host) - 1] = 0;
        memmove(host, host + 1, strlen(host));
    }
    struct in_addr four;
    struct in6_addr six;
    return strcmp(host, "localhost") == 0 || (inet_pton(AF_INET, host, &four) == 1 && ntohl(four.s_addr) >> 24 == 127) ||
           (inet_pton(AF_INET6, host, &six) == 1 && IN6_IS_ADDR_LOOPBACK(&six));
}

/* Reads the key from the line `name = "key"` of a key file. */
static bool key_named(const char *content, const char *name, char key[KEY_SIZE])
{
    for (const char *line = content; line; line = strchr(line, '\n')) {
        line += *line == '\n';
        size_t size = strlen(name);
        if (strncmp(line, name, size) != 0 || !starts_with(line + size, " = \""))
            continue;
        const char *value = line + size + strlen(" = \"");
        if (strcspn(value, "\"\n") == KEY_SIZE - 1 && value[KEY_SIZE - 1] == '"') {
            memcpy(key, value, KEY_SIZE - 1);
            key[KEY_SIZE - 1] = 0;
            return true;
        }
    }
    return false;
}

static bool read_key_file(const char *path, char content[LARGEST_KEY_FILE + 1], char why[FMFTS_TEXT_SIZE])
{
    /* Without O_NONBLOCK a pipe in the file's place would make the reader wait for ever. */
    int descriptor = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    struct stat found;
    ssize_t size = -1;
    if (descriptor >= 0 && fstat(descriptor, &found) == 0)
        size = S_ISREG(found.st_mode) ? read(descriptor, content, LARGEST_KEY_FILE) : 0;
    int error = errno;
    if (descriptor >= 0)
        close(descriptor);
    if (size < 0)
        return fail(why, "key %.120s cannot be read: %s", path, strerror(error));
    content[size] = 0;
    if (!S_ISREG(found.st_mode) || found.st_size > LARGEST_KEY_FILE)
        return fail(why, "key %.120s is not the file of a key: name the one that `fmfts-daemon keys new` wrote", path);
    /* The owner may read and write the file, and a service's group may read it. */
    if (found.st_mode & 037)
        return fail(why, "key %.100s is open to others (mode %04o): chmod 600 %.100s", path, found.st_mode & 07777U,
                    path);
    return true;
}

static bool set_key(void *socket, const char *path, char why[FMFTS_TEXT_SIZE])
{
    enum { SERVER, PUBLIC, SECRET, KEYS };
    static const struct {
        const char *name;
        int option;
    } halves[KEYS] = {
        {"server", ZMQ_CURVE_SERVERKEY}, {"public", ZMQ_CURVE_PUBLICKEY}, {"secret", ZMQ_CURVE_SECRETKEY}};
    char content[LARGEST_KEY_FILE + 1] = {0}, keys[KEYS][KEY_SIZE] = {{0}}, fitting[KEY_SIZE] = {0};
    bool set = read_key_file(path, content, why);
    for (int i = 0; set && i < KEYS; i++)
        if (!key_named(content, halves[i].name, keys[i]) ||
            zmq_setsockopt(socket, halves[i].option, keys[i], KEY_SIZE) != 0)
            set = fail(why, "key %.120s has no usable %s: make another with `fmfts-daemon keys new NAME`", path,
                       halves[i].name);
    if (set && (zmq_curve_public(fitting, keys[SECRET]) != 0 || strcmp(fitting, keys[PUBLIC]) != 0))
        set = fail(why, "key %.80s is damaged: its public and its secret key are no pair: make another with "
                        "`fmfts-daemon keys new NAME`", path);
    explicit_bzero(content, sizeof content);
    explicit_bzero(keys, sizeof keys);
    return set;
}

/* Shows the key to a daemon on tcp. Over ipc no key is needed: the permissions of the socket decide who may connect. */
static bool show_key(void *socket, const char *endpoint, char why[FMFTS_TEXT_SIZE])
{
    if (!starts_with(endpoint, "tcp://"))
        return true;
    const char *path = named("FMFTS_KEY");
    if (path)
        return set_key(socket, path, why);
    return is_loopback(endpoint) ||
           fail(why, "%.100s is on the network, where fmfts-daemon speaks to keys only: `fmfts-daemon keys new NAME` on "
                     "its machine makes one, and FMFTS_KEY names the file here", endpoint);
}

/* ---- the client ---- */

enum {
    LARGEST_CONTACT = 1 << 16,
    LARGEST_MESSAGE = 1 << 20, /* ZeroMQ closes the connection on a larger one */
    HIGH_MARK = 256,           /* contacts in the queue: about a second of one pad */
    MOST_AT_ONCE = 1024        /* messages read in one fmfts_latest(), so that a flood does not delay a control loop */
};

/* By how much this machine's monotonic clock is ahead of the daemon's: the smallest difference between arrival and
 * sending so far. It contains the shortest delay of the network. A message that waited in a queue has a larger
 * difference, which shows its age. Nothing is known until messages have come for a while, because a backlog arrives all
 * at once. A new `boot` starts again, as the daemon's machine may have been restarted. */
struct sender_clock {
    double ahead_s, first_s, last_s;
    char boot[FMFTS_WORD_SIZE];
};

struct fmfts_client {
    void *context, *socket;
    bool remote;
    struct sender_clock clock;
    char endpoint[ENDPOINT_SIZE];
    char topic[sizeof "contact/" + FMFTS_WORD_SIZE];
    char refusal[FMFTS_TEXT_SIZE];
    uint64_t refused, refused_before, restarts; /* refused_before: the last contact */
    double largest_force_sd_n;
    bool names_force_sd;
    bool heard;
    struct fmfts_contact last, next;
    uint8_t body[LARGEST_CONTACT];
};

static bool set_option(void *socket, int option, const void *value, size_t size, char why[FMFTS_TEXT_SIZE])
{
    return zmq_setsockopt(socket, option, value, size) == 0 || fail(why, "ZeroMQ: %s", zmq_strerror(zmq_errno()));
}

static bool open_socket(struct fmfts_client *client, const char *endpoint, char why[FMFTS_TEXT_SIZE])
{
    int none = 0, high_mark = HIGH_MARK;
    int64_t largest = LARGEST_MESSAGE;
    client->context = zmq_ctx_new();
    client->socket = client->context ? zmq_socket(client->context, ZMQ_SUB) : NULL;
    if (!client->socket)
        return fail(why, "ZeroMQ: %s", zmq_strerror(zmq_errno()));
    /* ZMQ_CONFLATE cannot be used: it drops the topic part. */
    return set_option(client->socket, ZMQ_LINGER, &none, sizeof none, why) &&
           set_option(client->socket, ZMQ_RCVHWM, &high_mark, sizeof high_mark, why) &&
           set_option(client->socket, ZMQ_MAXMSGSIZE, &largest, sizeof largest, why) &&
           set_option(client->socket, ZMQ_SUBSCRIBE, client->topic, strlen(client->topic), why) &&
           show_key(client->socket, endpoint, why);
}

static bool connect_to(struct fmfts_client *client, const char *endpoint, char why[FMFTS_TEXT_SIZE])
{
    /* tcp may lead to another machine: through a tunnel, even with a loopback address. */
    client->remote = starts_with(endpoint, "tcp://");
    return zmq_connect(client->socket, endpoint) == 0 ||
           fail(why, "cannot connect to %.120s: %s", endpoint, zmq_strerror(zmq_errno()));
}

struct fmfts_client *fmfts_connect(const char *pad, const char *endpoint, char why[FMFTS_TEXT_SIZE])
{
    char bus[ENDPOINT_SIZE];
    if (!pad || !*pad || strlen(pad) >= FMFTS_WORD_SIZE) {
        fail(why, "a pad's name has 1 to %d bytes", FMFTS_WORD_SIZE - 1);
        return NULL;
    }
    if (!find_bus(endpoint, bus, why))
        return NULL;
    struct fmfts_client *client = calloc(1, sizeof *client);
    if (!client) {
        fail(why, "no memory");
        return NULL;
    }
    client->largest_force_sd_n = FMFTS_LARGEST_FORCE_SD_N;
    snprintf(client->topic, sizeof client->topic, "contact/%s", pad);
    snprintf(client->endpoint, sizeof client->endpoint, "%s", bus);
    if (open_socket(client, bus, why) && connect_to(client, bus, why))
        return client;
    fmfts_close(client);
    return NULL;
}

void fmfts_close(struct fmfts_client *client)
{
    if (!client)
        return;
    if (client->socket)
        zmq_close(client->socket);
    if (client->context)
        zmq_ctx_term(client->context);
    free(client);
}

static int64_t monotonic_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

/* In floating point, because the daemon's time may be any integer. */
static double age_s(const struct fmfts_contact *contact, int64_t then_ns)
{
    double age_s = 1e-9 * ((double)monotonic_ns() - (double)then_ns);
    return contact->clock_ahead_s.known ? age_s - contact->clock_ahead_s.value : INFINITY;
}

static bool is_recent(const struct fmfts_contact *contact, int64_t then_ns)
{
    double seconds = age_s(contact, then_ns);
    return seconds >= 0 && seconds < 1e-3 * FMFTS_ALIVE_MS;
}

static void hear_clock(struct sender_clock *clock, const struct fmfts_contact *contact)
{
    static const double drift = 500e-6; /* relaxes the minimum: more than two crystals and NTP drift apart */
    double now_s = 1e-9 * (double)monotonic_ns(), ahead_s = now_s - 1e-9 * (double)contact->t_publish_ns;
    if (strcmp(clock->boot, contact->boot) != 0) {
        memcpy(clock->boot, contact->boot, sizeof clock->boot);
        clock->ahead_s = ahead_s;
        clock->first_s = clock->last_s = now_s;
    }
    clock->ahead_s += drift * (now_s - clock->last_s);
    if (ahead_s < clock->ahead_s)
        clock->ahead_s = ahead_s;
    clock->last_s = now_s;
}

/* Fills in `clock_ahead_s` of `next`. Without a known clock, contacts from another machine have no age. */
static void place_in_time(struct fmfts_client *client)
{
    if (!client->remote)
        return;
    hear_clock(&client->clock, &client->next);
    bool known = client->clock.last_s - client->clock.first_s >= 1e-3 * FMFTS_ALIVE_MS;
    client->next.clock_ahead_s = (struct fmfts_number){known, known ? client->clock.ahead_s : NAN};
}

/* Receives one part of a message into `part`. Returns its size, which may be more than `room`; negative: no part. */
static int receive(struct fmfts_client *client, void *part, size_t room, int *more)
{
    size_t size = sizeof *more;
    int received = zmq_recv(client->socket, part, room, ZMQ_DONTWAIT);
    *more = 0;
    if (received >= 0)
        zmq_getsockopt(client->socket, ZMQ_RCVMORE, more, &size);
    return received;
}

static enum fmfts_result refuse(struct fmfts_client *client, const char *why)
{
    client->refused++;
    fail(client->refusal, "%s", why);
    return FMFTS_REFUSED;
}

static enum fmfts_result accept_body(struct fmfts_client *client, size_t size)
{
    char why[FMFTS_TEXT_SIZE];
    enum fmfts_result result = fmfts_decode(client->body, size, &client->next, why);
    if (result == FMFTS_WRONG_VERSION)
        fail(client->refusal, "%s", why);
    if (result == FMFTS_REFUSED)
        return refuse(client, why);
    if (result != FMFTS_NEW)
        return result;
    if (strcmp(client->next.pad, client->topic + strlen("contact/")) != 0)
        return refuse(client, "it speaks of another pad than its topic");
    place_in_time(client);
    client->restarts += client->heard && strcmp(client->next.boot, client->last.boot) != 0;
    client->heard = true;
    client->refused_before = client->refused;
    client->last = client->next;
    return FMFTS_NEW;
}

/* Receives one message. FMFTS_REFUSED: it is for another pad, or must not be used. */
static enum fmfts_result take(struct fmfts_client *client)
{
    char topic[sizeof client->topic];
    int more, parts = 1;
    int size = receive(client, topic, sizeof topic, &more);
    if (size < 0)
        return zmq_errno() == EAGAIN || zmq_errno() == EINTR ? FMFTS_NOTHING : FMFTS_FAILED;
    /* ZeroMQ matches prefixes: a subscription to contact/left gets contact/left2 as well. */
    bool ours = (size_t)size == strlen(client->topic) && memcmp(topic, client->topic, (size_t)size) == 0;
    for (size = 0; more; parts++)
        size = receive(client, client->body, sizeof client->body, &more);
    if (!ours)
        return FMFTS_REFUSED;
    if (parts != 2)
        return refuse(client, "not two parts, topic and body");
    if (size < 0 || (size_t)size > sizeof client->body)
        return refuse(client, "longer than 64 KiB");
    return accept_body(client, (size_t)size);
}

/* Receives all messages that have arrived. FMFTS_NEW: `last` is a newer contact than before. */
static enum fmfts_result drain(struct fmfts_client *client)
{
    enum fmfts_result newest = FMFTS_NOTHING;
    for (int i = 0; i < MOST_AT_ONCE; i++) {
        enum fmfts_result result = take(client);
        if (result == FMFTS_NEW)
            newest = FMFTS_NEW;
        else if (result == FMFTS_NOTHING)
            break;
        else if (result != FMFTS_REFUSED)
            return result;
    }
    return newest;
}

enum fmfts_result fmfts_latest(struct fmfts_client *client, struct fmfts_contact *contact, int timeout_ms)
{
    int64_t deadline_ns = monotonic_ns() + timeout_ms * INT64_C(1000000);
    for (;;) {
        enum fmfts_result result = drain(client);
        if (result == FMFTS_NEW && fmfts_alive(client)) {
            *contact = client->last;
            return FMFTS_NEW;
        }
        if (result < 0)
            return result;
        int64_t left_ns = deadline_ns - monotonic_ns();
        if (timeout_ms >= 0 && left_ns <= 0)
            return FMFTS_NOTHING;
        zmq_pollitem_t readable = {.socket = client->socket, .events = ZMQ_POLLIN};
        if (zmq_poll(&readable, 1, timeout_ms < 0 ? -1 : (long)((left_ns + 999999) / 1000000)) < 0)
            return zmq_errno() == EINTR ? FMFTS_NOTHING : FMFTS_FAILED;
    }
}

bool fmfts_alive(const struct fmfts_client *client)
{
    return client->heard && is_recent(&client->last, client->last.t_publish_ns);
}

bool fmfts_fresh(const struct fmfts_client *client)
{
    return client->heard && is_recent(&client->last, client->last.t_sample_ns);
}

static double largest_force_sd_n(const struct fmfts_client *client)
{
    double third_n = client->names_force_sd ? 0.0 : client->last.force_n.value / 3.0;
    return third_n > client->largest_force_sd_n ? third_n : client->largest_force_sd_n;
}

bool fmfts_valid(const struct fmfts_client *client)
{
    const struct fmfts_number *deviation = &client->last.force_sd_n;
    return fmfts_alive(client) && fmfts_fresh(client) && fmfts_measured(&client->last) && deviation->known &&
           deviation->value <= largest_force_sd_n(client);
}

/* Writes `why` and returns false. */
static bool explain(const struct fmfts_client *client, char why[FMFTS_TEXT_SIZE])
{
    const struct fmfts_contact *last = &client->last;
    uint64_t refused = client->refused - client->refused_before;
    if (!fmfts_alive(client) && refused)
        return fail(why, "nothing usable arrives (messages refused: %" PRIu64 "): %s", refused, client->refusal);
    if (!fmfts_alive(client))
        return fail(why, "nothing arrives");
    if (last->health == FMFTS_HEALTH_UNKNOWN)
        return fail(why, "its health is not known to this client: install the client of the daemon's version");
    if (last->health != FMFTS_OK)
        return fail(why, "%s%s%s", fmfts_health_name(last->health), last->reason[0] ? ": " : "", last->reason);
    if (!fmfts_fresh(client))
        return fail(why, "the pad was not sampled for %g s or more", 1e-3 * FMFTS_ALIVE_MS);
    if (last->over_range)
        return fail(why, "the pad is pressed harder than its contact model knows");
    if (!fmfts_measured(last))
        return fail(why, last->force_n.known && last->contact == FMFTS_TOUCHED ? "the place is not known" : "the force is not known");
    return fail(why, "the force is %.2f ± %.3f N, less certain than ± %.3f N: `fmfts-daemon baseline --turn` and `weigh` make it more certain",
                last->force_n.value, last->force_sd_n.known ? last->force_sd_n.value : INFINITY, largest_force_sd_n(client));
}

bool fmfts_why_invalid(const struct fmfts_client *client, char why[FMFTS_TEXT_SIZE])
{
    *why = 0;
    return fmfts_valid(client) || explain(client, why);
}

void fmfts_set_largest_force_sd(struct fmfts_client *client, double newton)
{
    client->largest_force_sd_n = newton;
    client->names_force_sd = true;
}

uint64_t fmfts_refused(const struct fmfts_client *client)
{
    return client->refused;
}

uint64_t fmfts_restarts(const struct fmfts_client *client)
{
    return client->restarts;
}

const char *fmfts_refusal(const struct fmfts_client *client)
{
    return client->refusal;
}

bool fmfts_measured(const struct fmfts_contact *contact)
{
    bool known = contact->health == FMFTS_OK && contact->contact != FMFTS_TOUCH_UNKNOWN && contact->force_n.known;
    bool placed = contact->contact != FMFTS_TOUCHED || (contact->x_m.known && contact->y_m.known);
    return known && placed && !contact->over_range;
}

double fmfts_sample_age_s(const struct fmfts_contact *contact)
{
    return age_s(contact, contact->t_sample_ns);
}

enum { FARTHEST_MS = 20 }; /* further ahead than that a fast press may already be reversing */

static void grow(struct fmfts_number *number, const struct fmfts_number *rate, double ahead_s)
{
    number->known = number->known && rate->known;
    number->value = number->known ? number->value + rate->value * ahead_s : NAN;
}

static void carry(struct fmfts_number *value, struct fmfts_number *deviation, const struct fmfts_number *rate,
                  const struct fmfts_number *rate_deviation, double ahead_s)
{
    grow(value, rate, ahead_s);
    grow(deviation, rate_deviation, ahead_s < 0 ? -ahead_s : ahead_s);
}

bool fmfts_at(const struct fmfts_contact *contact, int64_t t_ns, struct fmfts_now *now)
{
    double ahead_s = 1e-9 * ((double)t_ns - (double)contact->now.t_ns) - contact->clock_ahead_s.value;
    *now = contact->now;
    if (!now->known || !contact->clock_ahead_s.known || !(ahead_s >= -1e-3 * FARTHEST_MS && ahead_s <= 1e-3 * FARTHEST_MS)) {
        memset(now, 0, sizeof *now);
        set_unknown(NOW, (char *)now);
        return false;
    }
    carry(&now->x_m, &now->x_sd_m, &now->x_rate_m_per_s, &now->x_rate_sd_m_per_s, ahead_s);
    carry(&now->y_m, &now->y_sd_m, &now->y_rate_m_per_s, &now->y_rate_sd_m_per_s, ahead_s);
    carry(&now->force_n, &now->force_sd_n, &now->force_rate_n_per_s, &now->force_rate_sd_n_per_s, ahead_s);
    carry(&now->shear_x_n, &now->shear_x_sd_n, &now->shear_x_rate_n_per_s, &now->shear_x_rate_sd_n_per_s, ahead_s);
    carry(&now->shear_y_n, &now->shear_y_sd_n, &now->shear_y_rate_n_per_s, &now->shear_y_rate_sd_n_per_s, ahead_s);
    if (now->force_n.value < 0)
        now->force_n.value = 0;
    now->t_ns += (int64_t)(1e9 * ahead_s);
    return true;
}

/* ---- why nothing arrives: as clients/python/fmfts_client/diagnosis.py finds it ---- */

enum { MOST_PADS = 16, MONITORED = 6 /* bytes of a monitor's first part: the event (16 bits) and its value */ };

/* events: of the connection, as libzmq reports them. wrong: what is wrong with the pad's own messages. */
struct heard {
    unsigned events;
    int pads;
    bool sound;
    char wrong[FMFTS_TEXT_SIZE];
    char pad[MOST_PADS][FMFTS_WORD_SIZE];
};

/* libzmq before 4.3 does not report how a handshake ended. */
#ifdef ZMQ_EVENT_HANDSHAKE_FAILED_AUTH
enum {
    REFUSED_KEY = ZMQ_EVENT_HANDSHAKE_FAILED_AUTH,
    OTHER_PROTOCOL = ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL | ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL,
    SERVED = ZMQ_EVENT_HANDSHAKE_SUCCEEDED
};
#else
enum { REFUSED_KEY = 0, OTHER_PROTOCOL = 0, SERVED = ZMQ_EVENT_CONNECTED };
#endif

/* The edit distance: how many letters must be added, removed or changed to turn one word into the other. */
static size_t edits(const char *one, const char *other)
{
    size_t row[FMFTS_WORD_SIZE], length = strlen(other);
    for (size_t j = 0; j <= length; j++)
        row[j] = j;
    for (size_t i = 1; one[i - 1]; i++) {
        size_t before = row[0];
        row[0] = i;
        for (size_t j = 1; j <= length; j++) {
            size_t changed = before + (one[i - 1] != other[j - 1]), added = row[j - 1] + 1;
            before = row[j];
            row[j] = row[j] + 1 < added ? row[j] + 1 : added;
            row[j] = changed < row[j] ? changed : row[j];
        }
    }
    return row[length];
}

/* The pad whose name differs from `wanted` in the fewest letters; NULL if half or more of them differ. */
static const char *nearest_name(const struct heard *heard, const char *wanted)
{
    const char *nearest = NULL;
    size_t fewest = SIZE_MAX;
    for (int i = 0; i < heard->pads; i++) {
        const char *name = heard->pad[i];
        size_t count = edits(wanted, name), longer = strlen(name) > strlen(wanted) ? strlen(name) : strlen(wanted);
        if (count < fewest && 2 * count < longer) {
            nearest = name;
            fewest = count;
        }
    }
    return nearest;
}

/* Keeps the names in the order of the alphabet. */
static void hear_pad(struct heard *heard, const char *name)
{
    int at = 0;
    while (at < heard->pads && strcmp(heard->pad[at], name) < 0)
        at++;
    size_t size = strlen(name) + 1;
    if (size > FMFTS_WORD_SIZE || heard->pads == MOST_PADS || (at < heard->pads && strcmp(heard->pad[at], name) == 0))
        return;
    memmove(heard->pad[at + 1], heard->pad[at], (size_t)(heard->pads - at) * FMFTS_WORD_SIZE);
    memcpy(heard->pad[at], name, size);
    heard->pads++;
}

/* Takes one message of any pad, if there is one. */
static bool hear_message(struct fmfts_client *all, const char *pad, struct heard *heard)
{
    char topic[sizeof all->topic] = {0}, why[FMFTS_TEXT_SIZE];
    int more, size = receive(all, topic, sizeof topic - 1, &more), body = 0;
    if (size < 0)
        return false;
    while (more)
        body = receive(all, all->body, sizeof all->body, &more);
    if ((size_t)size >= sizeof topic || strlen(topic) <= strlen("contact/"))
        return true;
    const char *name = topic + strlen("contact/");
    size_t known = body < 0 ? 0 : (size_t)body < sizeof all->body ? (size_t)body : sizeof all->body;
    enum fmfts_result result = fmfts_decode(all->body, known, &all->next, why);
    if (result == FMFTS_WRONG_VERSION)
        fail(heard->wrong, "%s", why);
    else
        hear_pad(heard, name);
    if (result == FMFTS_REFUSED && strcmp(name, pad) == 0)
        fail(heard->wrong, "a message of pad '%.64s' must not be used: %.150s", pad, why);
    heard->sound |= result == FMFTS_NEW && strcmp(name, pad) == 0;
    return true;
}

static void hear_events(void *monitor, struct heard *heard)
{
    uint8_t event[MONITORED];
    char address[ENDPOINT_SIZE];
    while (zmq_recv(monitor, event, sizeof event, ZMQ_DONTWAIT) == MONITORED) {
        uint16_t bits;
        memcpy(&bits, event, sizeof bits);
        heard->events |= bits;
        zmq_recv(monitor, address, sizeof address, ZMQ_DONTWAIT);
    }
}

static void hear_all(struct fmfts_client *all, void *monitor, const char *pad, int timeout_ms, struct heard *heard)
{
    int64_t deadline_ns = monotonic_ns() + timeout_ms * INT64_C(1000000);
    while (!heard->sound && !*heard->wrong && monotonic_ns() < deadline_ns) {
        zmq_pollitem_t readable = {.socket = all->socket, .events = ZMQ_POLLIN};
        zmq_poll(&readable, 1, 50);
        for (int i = 0; i < MOST_AT_ONCE && !heard->sound && hear_message(all, pad, heard); i++) {
        }
        hear_events(monitor, heard);
    }
}

static bool why_not_connected(const char *bus, unsigned events, char why[FMFTS_TEXT_SIZE])
{
    const char *key = starts_with(bus, "tcp://") ? named("FMFTS_KEY") : NULL;
    if (events & REFUSED_KEY)
        return fail(why, "the daemon at %s refuses the key in %s: `fmfts-daemon keys list` there shows those it "
                         "knows", bus, key ? key : "FMFTS_KEY");
    if (events & OTHER_PROTOCOL && !key)
        return fail(why, "the daemon at %s accepts only clients with a key: set FMFTS_KEY to the file of yours", bus);
    if (events & OTHER_PROTOCOL || (key && events & ZMQ_EVENT_DISCONNECTED))
        return fail(why, "the daemon at %s has other keys than %s says, or none: get a new key from its machine",
                    bus, key ? key : "FMFTS_KEY");
    if (events & SERVED)
        return fail(why, "a program serves %s and sends no contacts: a daemon that starts needs five seconds; is it "
                         "fmfts-daemon, and does `fmfts-daemon status` answer?", bus);
    const char *path = bus + strlen("ipc://");
    if (starts_with(bus, "ipc://") && access(path, W_OK) != 0 && errno == EACCES)
        return fail(why, "%s is closed to you: join the group of its daemon (as a service: sudo usermod -aG fmfts "
                         "$USER, then log in again)", path);
    return fail(why, "no daemon at %s: is fmfts-daemon running, and on this endpoint (FMFTS_BUS)?", bus);
}

static bool tell_pads(const char *bus, const char *pad, const struct heard *heard, char why[FMFTS_TEXT_SIZE])
{
    char names[FMFTS_TEXT_SIZE] = "";
    for (int i = 0; i < heard->pads; i++) {
        size_t used = strlen(names);
        snprintf(names + used, sizeof names - used, "%s'%s'", i ? ", " : "", heard->pad[i]);
    }
    const char *nearest = nearest_name(heard, pad);
    if (nearest)
        return fail(why, "no pad '%s' at %s; did you mean '%s'? It has %s", pad, bus, nearest, names);
    return fail(why, "no pad '%s' at %s; it has %s", pad, bus, names);
}

bool fmfts_why(const struct fmfts_client *client, int timeout_ms, char why[FMFTS_TEXT_SIZE])
{
    static const char watched[] = "inproc://fmfts-why";
    const char *pad = client->topic + strlen("contact/");
    struct heard heard = {0};
    *why = 0;
    struct fmfts_client *all = calloc(1, sizeof *all);
    if (!all)
        return fail(why, "no memory");
    snprintf(all->topic, sizeof all->topic, "contact/");
    void *monitor = NULL;
    bool listens = open_socket(all, client->endpoint, why);
    if (listens && zmq_socket_monitor(all->socket, watched, ZMQ_EVENT_ALL) == 0)
        monitor = zmq_socket(all->context, ZMQ_PAIR);
    listens = listens && monitor && zmq_connect(monitor, watched) == 0 && connect_to(all, client->endpoint, why);
    if (listens)
        hear_all(all, monitor, pad, timeout_ms, &heard);
    if (monitor) {
        zmq_socket_monitor(all->socket, NULL, 0);
        zmq_close(monitor);
    }
    fmfts_close(all);
    if (!listens)
        return *why ? false : fail(why, "ZeroMQ: %s", zmq_strerror(zmq_errno()));
    if (heard.sound)
        return true;
    if (*heard.wrong)
        return fail(why, "%s", heard.wrong);
    return heard.pads ? tell_pads(client->endpoint, pad, &heard, why)
                      : why_not_connected(client->endpoint, heard.events, why);
}
