/* libFuzzer's target: for any input, an accepted contact is complete, and the same each time. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../clients/c/fmfts.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void require(bool condition, const char *what)
{
    if (!condition) {
        fprintf(stderr, "fuzz: not so: %s\n", what);
        abort();
    }
}

static void require_number(const struct fmfts_number *number)
{
    require(number->known ? isfinite(number->value) : isnan(number->value), "a number is finite, or known to be none");
}

static void require_pose(const struct fmfts_pose *pose)
{
    for (int i = 0; i < 3; i++) {
        double sum = pose->position_m[i] * 0 + pose->axis[i] * 0 + pose->position_sd_m[i] * 0;
        require(pose->known ? sum == 0 : isnan(sum), "a pose is finite, or known to be none");
        require(pose->known ? pose->ambient_t.known == (bool)isfinite(pose->ambient_t.value[i]) : !pose->ambient_t.known,
                "an ambient field is finite, or known to be none");
    }
}

static void require_fingers(const struct fmfts_fingers *fingers)
{
    require(fingers->count >= 0 && fingers->count <= FMFTS_MAX_FINGERS, "fingers have places");
    require(fingers->known || fingers->count == 0, "no finger is told where fingers are not known");
    for (int i = 0; i < FMFTS_MAX_FINGERS; i++) {
        const struct fmfts_finger *finger = &fingers->finger[i];
        double sum = 0 * finger->x_m + 0 * finger->y_m + 0 * finger->x_sd_m + 0 * finger->y_sd_m;
        sum += 0 * finger->force_n + 0 * finger->force_sd_n;
        require(i < fingers->count ? sum == 0 : isnan(sum), "a finger is finite, or known to be none");
        const struct fmfts_number *shear = &finger->shear_x_n;
        for (int j = 0; j < 4; j++)
            require_number(&shear[j]);
    }
}

static void require_whole(const struct fmfts_contact *contact)
{
    const struct fmfts_number *numbers[] = {
        &contact->temperature_c, &contact->x_m,       &contact->x_sd_m,       &contact->y_m,
        &contact->y_sd_m,        &contact->force_n,   &contact->force_sd_n,   &contact->shear_x_n,
        &contact->shear_x_sd_n,  &contact->shear_y_n, &contact->shear_y_sd_n, &contact->force_min_n,
        &contact->displacement_m, &contact->displacement_sd_m};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        require_number(numbers[i]);
    const struct fmfts_now *now = &contact->now;
    const struct fmfts_number *of_now = &now->x_m;
    for (size_t i = 0; i < 20; i++)
        require_number(&of_now[i]);
    require(now->known == now->force_n.known, "now is known with its force, or not at all");
    const struct fmfts_number *of_slip = &contact->slip.sticking_probability;
    for (size_t i = 0; i < 9; i++)
        require_number(&of_slip[i]);
    require_pose(&contact->pose);
    require_fingers(&contact->contacts);
    const struct fmfts_poses *poses = &contact->poses;
    require(poses->count >= 0 && poses->count <= FMFTS_MAX_MAGNETS && (poses->known || !poses->count), "poses have places");
    for (int i = 0; i < FMFTS_MAX_MAGNETS; i++) {
        require(poses->pose[i].known == (i < poses->count), "as many poses are known as are counted");
        require_pose(&poses->pose[i]);
    }
    require(memchr(contact->reason, 0, sizeof contact->reason) && memchr(contact->pad, 0, sizeof contact->pad) &&
                memchr(contact->baseline.value, 0, sizeof contact->baseline.value),
            "text ends");
    require((unsigned)contact->health <= FMFTS_NO_BASELINE, "health is one of its words");
    require(!fmfts_measured(contact) || contact->force_n.known, "what is measured has a force");
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct fmfts_contact contact, again;
    char why[FMFTS_TEXT_SIZE];
    memset(&contact, 0x5A, sizeof contact);
    enum fmfts_result result = fmfts_decode(data, size, &contact, why);
    require((result == FMFTS_NEW) == (*why == 0), "a refusal has its reason, and nothing else has");
    if (result == FMFTS_NEW) {
        require_whole(&contact);
        require(fmfts_decode(data, size, &again, why) == FMFTS_NEW, "accepted once, accepted again");
        require(memcmp(&contact, &again, sizeof again) == 0, "and the same");
    }
    return 0;
}
