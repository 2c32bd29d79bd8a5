/* For test_message_bytes.py: makes a reading from plain numbers, and its message. */
#include "../../daemon/fmfts/pipeline/frame.h"

#include <string.h>

enum { OUTPUTS = FMFTS_CONTACT };

static const double *take(double *to, const double *from, size_t count)
{
    memcpy(to, from, count * sizeof *to);
    return from + count;
}

static void fill(fmfts_reading *r, const double *number)
{
    number = take(&r->temperature_c, number, 1);
    number = take(r->estimate.place, number, OUTPUTS);
    number = take(r->estimate.deviation, number, OUTPUTS);
    number = take(&r->force_n, number, 1);
    number = take(&r->force_sd_n, number, 1);
    number = take(&r->force_min_n, number, 1);
    number = take(&r->displacement_m, number, 1);
    number = take(&r->displacement_sd_m, number, 1);
    number = take(r->pose.position_m, number, 3);
    number = take(r->pose.position_sd_m, number, 3);
    number = take(r->pose.axis, number, 3);
    number = take(&r->pose.axis_sd_rad, number, 1);
    number = take(&r->pose.remanence_t, number, 1);
    number = take(&r->pose.remanence_sd_t, number, 1);
    number = take(r->ambient_t, number, 3);
    number = take(r->ambient_sd_t, number, 3);
    number = take(&r->residual_t, number, 1);
    number = take(&r->chi2, number, 1);
    number = take(r->now.contact.value, number, OUTPUTS);
    number = take(r->now.contact.deviation, number, OUTPUTS);
    number = take(r->now.contact.rate, number, OUTPUTS);
    number = take(r->now.contact.rate_deviation, number, OUTPUTS);
    number = take(&r->slip.sticking, number, 1);
    number = take(&r->slip.speed_m_per_s, number, 1);
    number = take(&r->slip.speed_sd_m_per_s, number, 1);
    number = take(&r->slip.direction_rad, number, 1);
    number = take(&r->slip.direction_sd_rad, number, 1);
    number = take(&r->slip.friction, number, 1);
    number = take(&r->slip.friction_sd, number, 1);
    number = take(&r->slip.margin_n, number, 1);
    take(&r->slip.margin_sd_n, number, 1);
}

/* Finger number f (magnet m) has the numbers of the reading times f + 1 (m + 1), so that each has its own. */
static void fill_several(const fmfts_reading *r, fmfts_told_several *several)
{
    for (size_t f = 0; f < several->fingers; f++) {
        fmfts_told_finger *finger = &several->finger[f];
        finger->id = (int64_t)(100 * f) + 7;
        finger->outputs = r->estimate.outputs;
        for (int i = 0; i < OUTPUTS; i++) {
            finger->value[i] = r->estimate.place[i] * (double)(f + 1);
            finger->deviation[i] = r->estimate.deviation[i] * (double)(f + 1);
        }
    }
    for (size_t m = 0; m < several->magnets; m++) {
        double *to = (double *)&several->pose[m];
        const double *from = (const double *)&r->pose;
        for (size_t i = 0; i < sizeof r->pose / sizeof *to; i++) {
            to[i] = from[i] * (double)(m + 1);
        }
    }
}

/* flags: health, contact, over_range, tells_force, tells_place, tells_force_min, tells_displacement, tells_pose, outputs, now.known,
 * now.places, tells_slip, slip.known, slip.slipping, slip.knows_friction; several magnets, more, tells_fingers, fingers, tells_poses, magnets. integers: version, number, the four times, sensors_ok. words: pad, boot, reason, model, baseline or NULL. */
size_t write_message(const double *numbers, const int *flags, const int64_t *integers, const char *const *words,
                     uint8_t *message, int *is_finite)
{
    fmfts_reading r = {
        .health = (fmfts_health)flags[0],
        .contact = (fmfts_contact)flags[1],
        .over_range = flags[2],
        .tells_force = flags[3],
        .tells_place = flags[4],
        .tells_force_min = flags[5],
        .tells_displacement = flags[6],
        .tells_pose = flags[7],
        .estimate.outputs = flags[8],
        .now = {.known = flags[9], .places = flags[10], .contact.outputs = flags[8]},
        .tells_slip = flags[11],
        .slip = {.known = flags[12], .slipping = flags[13], .knows_friction = flags[14]},
        .sensors_ok = (unsigned)integers[6],
    };
    const fmfts_words told = {
        .version = integers[0], .pad = words[0], .boot = words[1], .model = words[3], .baseline = words[4]};
    const fmfts_times times = {integers[2], integers[3], integers[4], integers[5]};
    fmfts_told_several several = {.more = flags[16], .tells_fingers = flags[17], .fingers = (size_t)flags[18],
                                  .tells_poses = flags[19], .magnets = (size_t)flags[20]};
    fill(&r, numbers);
    fill_several(&r, &several);
    r.several = flags[15] ? &several : NULL;
    r.reason.size = strlen(words[2]);
    memcpy(r.reason.text, words[2], r.reason.size);
    *is_finite = fmfts_is_finite(&r);
    return fmfts_write_message(&told, &r, integers[1], &times, message);
}

size_t room(void)
{
    return FMFTS_MESSAGE_ROOM;
}

const char *health_name(int health)
{
    return health < FMFTS_HEALTHS ? fmfts_health_name((fmfts_health)health) : NULL;
}
