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
    number = take(&r->estimate.force_min_n, number, 1);
    number = take(&r->displacement_m, number, 1);
    number = take(&r->displacement_sd_m, number, 1);
    number = take(r->position_m, number, 3);
    number = take(r->position_sd_m, number, 3);
    number = take(r->axis, number, 3);
    number = take(&r->axis_sd_rad, number, 1);
    number = take(&r->remanence_t, number, 1);
    number = take(&r->remanence_sd_t, number, 1);
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

/* flags: health, contact, over_range, tells_force, tells_place, tells_force_min, tells_displacement, tells_pose, outputs, now.known,
 * now.places, tells_slip, slip.known, slip.slipping, slip.knows_friction. integers: version, number, the four times, sensors_ok. words: pad, boot, reason, model, baseline or NULL. */
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
    fill(&r, numbers);
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
