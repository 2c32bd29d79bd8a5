/* One frame of one pad, from counts to its message; frame.c names the steps in order. */
#ifndef FMFTS_FRAME_H
#define FMFTS_FRAME_H

#include "../contact/now.h"
#include "../contact/slip.h"
#include "../pose/motion.h"

/* What a message needs of a pad. */
#define FMFTS_MESSAGE_PARAMETERS(ONE, MANY)                                                                            \
    ONE(double, has_baseline) /* 0: nothing is subtracted, and nothing estimated */                                    \
    ONE(double, has_model) /* 0: no contact model, so that places and forces are not known */                          \
    ONE(double, detection_limit_n)                                                                                     \
    MANY(double, rest_variance, 6)                                                                                     \
    ONE(double, remanence_t)                                                                                           \
    MANY(double, ambient_t, 3) /* NaN: not measured */                                                                 \
    MANY(double, ambient_variance, 3)

#define FMFTS_MESSAGE_MEMORY(ONE, MANY)                                                                                \
    ONE(int64_t, number) /* of the last message */                                                                     \
    ONE(int64_t, sampled_ns) /* host's time of the last sample */

FMFTS_STRUCT(fmfts_message_parameters, FMFTS_MESSAGE_PARAMETERS)
FMFTS_STRUCT(fmfts_message_memory, FMFTS_MESSAGE_MEMORY)

#define FMFTS_PARAMETERS(ONE, MANY)                                                                                    \
    FMFTS_POSE_PARAMETERS(ONE, MANY)                                                                                   \
    FMFTS_CONTACT_PARAMETERS(ONE, MANY)                                                                                \
    FMFTS_MOTION_PARAMETERS(ONE, MANY)                                                                                 \
    FMFTS_NOW_PARAMETERS(ONE, MANY)                                                                                    \
    FMFTS_SLIP_PARAMETERS(ONE, MANY)                                                                                   \
    FMFTS_MESSAGE_PARAMETERS(ONE, MANY)
typedef struct {
    fmfts_pose_parameters pose;
    fmfts_contact_parameters contact;
    fmfts_motion_parameters motion;
    fmfts_now_parameters now;
    fmfts_slip_parameters slip;
    fmfts_message_parameters message;
} fmfts_parameters;

/* All that the next frame needs of the earlier ones. */
#define FMFTS_MEMORY(ONE, MANY)                                                                                        \
    FMFTS_POSE_MEMORY(ONE, MANY)                                                                                       \
    FMFTS_CONTACT_MEMORY(ONE, MANY)                                                                                    \
    FMFTS_MOTION_MEMORY(ONE, MANY)                                                                                     \
    FMFTS_NOW_MEMORY(ONE, MANY)                                                                                        \
    FMFTS_SLIP_MEMORY(ONE, MANY)                                                                                       \
    FMFTS_MESSAGE_MEMORY(ONE, MANY)
typedef struct {
    fmfts_pose_memory pose;
    fmfts_contact_memory contact;
    fmfts_motion_memory motion;
    fmfts_now_memory now;
    fmfts_slip_memory slip;
    fmfts_message_memory message;
} fmfts_memory;

/* A pad's texts. no_model, lifted: reasons; no_baseline: why there is none, or that rest is not recorded. model,
 * baseline: hash and id (NULL: none) of every message. version: of the messages' schema. */
typedef struct {
    int64_t version;
    const char *pad, *boot, *model, *baseline;
    const char *no_model, *no_baseline, *lifted;
    fmfts_chip_words chip;
} fmfts_words;

/* A pad, with all that its frames need besides their memory. response: as in refine.h, or NULL. own: its magnet's last
 * estimate. neighbour: those of its neighbours. hand: the posture's field. */
typedef struct {
    const fmfts_parameters *parameters;
    fmfts_network network;
    const void *response;
    size_t response_bytes;
    fmfts_words words;
    fmfts_sighting own, neighbour[FMFTS_FELT];
    fmfts_hand hand;
    fmfts_field_errors errors;
} fmfts_pad;

/* A message's `now`. places: x and y, too; else force alone. */
typedef struct {
    bool known, places;
    double time_us; /* on the board's clock */
    fmfts_contact_now contact; /* outputs: 3 or 5 */
} fmfts_now;

enum { FMFTS_TOLD_FINGERS = 2, FMFTS_TOLD_MAGNETS = FMFTS_MOST_TOGETHER };

/* A message's own numbers, in its order: each is null unless the flag of fmfts_reading before it is set. message.c writes whatever is
 * listed here, under its name. */
#define FMFTS_TOLD_NUMBERS(TOLD)                                                                                       \
    TOLD(tells_force_min, force_min_n)                                                                                 \
    TOLD(tells_displacement, displacement_m)                                                                           \
    TOLD(tells_displacement, displacement_sd_m)
#define FMFTS_TOLD_NUMBER(flag, name) double name;

/* A magnet's pose in a message, likewise. */
#define FMFTS_TOLD_POSE(ONE, MANY)                                                                                     \
    MANY(double, position_m, 3)                                                                                        \
    MANY(double, position_sd_m, 3)                                                                                     \
    MANY(double, axis, 3)                                                                                              \
    ONE(double, axis_sd_rad)                                                                                           \
    ONE(double, remanence_t)                                                                                           \
    ONE(double, remanence_sd_t)

FMFTS_STRUCT(fmfts_told_pose, FMFTS_TOLD_POSE)

/* One of several fingers in a message. outputs: 5; 3 without shear. */
typedef struct {
    int64_t id;
    int outputs;
    double value[FMFTS_CONTACT], deviation[FMFTS_CONTACT];
} fmfts_told_finger;

/* What a message of a pad with several magnets adds. more: no two fingers explain the field. */
typedef struct {
    bool more, tells_fingers, tells_poses;
    size_t fingers, magnets;
    fmfts_told_finger finger[FMFTS_TOLD_FINGERS];
    fmfts_told_pose pose[FMFTS_TOLD_MAGNETS];
} fmfts_told_several;

/* The last frame's values for samples that come before the next frame. moment: the covariance of the magnet's moment
 * with the pose, and its variance. known: the other values are valid. */
typedef struct {
    double drive[FMFTS_MOVED * FMFTS_MOVED], moment[FMFTS_MOVED + 1];
    bool known, over_range;
} fmfts_judged;

typedef enum { FMFTS_NOT_KNOWN, FMFTS_NO_CONTACT, FMFTS_IN_CONTACT } fmfts_contact;

/* The result of a frame, for its message. Numbers that are not published are not checked. */
typedef struct {
    fmfts_health health;
    fmfts_text reason;
    fmfts_missing missing;
    unsigned sensors_ok; /* mask */
    double temperature_c; /* NaN: unknown */
    fmfts_contact contact;
    bool over_range;
    bool tells_force, tells_place, tells_force_min, tells_displacement, tells_pose;
    fmfts_estimate estimate; /* place, force and shear, with deviations but for that of the force */
    double force_n, force_sd_n;
    FMFTS_TOLD_NUMBERS(FMFTS_TOLD_NUMBER)
    fmfts_told_pose pose;
    double ambient_t[3], ambient_sd_t[3]; /* NaN: not measured */
    double residual_t, chi2;
    fmfts_now now;
    bool tells_slip; /* whether it is configured, so that the message has the key */
    fmfts_slip slip;
    fmfts_judged judged;
    const fmfts_told_several *several; /* NULL: the pad has one magnet */
} fmfts_reading;

/* frame.c: judges one frame, in `memory`. False, and the memory is as before, if a number of its message is not finite. */
bool fmfts_judge(const fmfts_pad *pad, fmfts_memory *memory, const fmfts_frame *frame, fmfts_reading *reading);

/* now.c: takes a sample that came before its frame, and updates `now` in the last frame's reading. False if the sample
 * contains nothing new. */
bool fmfts_take_early(const fmfts_pad *pad, fmfts_memory *memory, const fmfts_early *early, fmfts_reading *reading);

/* now.c: the field of a sample as measured. */
void fmfts_read_early(const fmfts_pose_parameters *parameters, unsigned gain_code, const int16_t counts[3], double field_t[3]);

/* The times of a message in ns: on the host's monotonic clock, and UTC. now: the time of its `now`. */
typedef struct {
    int64_t sampled, published, utc, now;
} fmfts_times;

enum { FMFTS_MESSAGE_ROOM = FMFTS_TEXT_ROOM + 8192 };

/* message.c: encodes a reading as msgpack, as docs/messages.md has it; the bytes are those that msgspec makes of a
 * ContactMessage. Returns the size; 0 if there is no room, which only long words can cause. */
size_t fmfts_write_message(const fmfts_words *words, const fmfts_reading *reading, int64_t number, const fmfts_times *times,
                           uint8_t message[FMFTS_MESSAGE_ROOM]);

/* slip.c: whether the message says that the finger slips. */
bool fmfts_is_slipping(const fmfts_reading *reading);

/* message.c: the name of a health in messages. */
const char *fmfts_health_name(fmfts_health health);

/* message.c: whether all published numbers of the reading are finite. */
bool fmfts_is_finite(const fmfts_reading *reading);

#endif
