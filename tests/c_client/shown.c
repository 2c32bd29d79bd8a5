#include "shown.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* A known value is finite, and an unknown one cannot be mistaken for a number. */
static void show_number(bool known, double value)
{
    if (known != (bool)isfinite(value) || known == (bool)isnan(value))
        abort();
    if (known)
        printf("%.17g", value);
    else
        printf("null");
}

static void optional(const char *name, const struct fmfts_number *number)
{
    printf("\"%s\": ", name);
    show_number(number->known, number->value);
    printf(", ");
}

static void vector(const char *name, bool known, const double value[3])
{
    printf("\"%s\": %s", name, known ? "[" : "null, ");
    for (int i = 0; i < 3; i++) {
        if (!known && !isnan(value[i]))
            abort();
        if (known)
            printf("%.17g%s", value[i], i < 2 ? ", " : "], ");
    }
}

void show_text(const char *name, const char *text)
{
    printf("\"%s\": \"", name);
    for (const char *at = text; *at; at++)
        printf(*at == '"' || *at == '\\' || (unsigned char)*at < 0x20 ? "\\u%04x" : "%c", (unsigned char)*at);
    printf("\", ");
}

static void integer(const char *name, int64_t value)
{
    printf("\"%s\": %" PRId64 ", ", name, value);
}

static void show_pose(const struct fmfts_pose *pose)
{
    if (!pose->known) {
        if (!isnan(pose->position_m[2]) || !isnan(pose->remanence_t) || pose->ambient_t.known)
            abort();
        printf("null");
        return;
    }
    printf("{");
    vector("position_m", true, pose->position_m);
    vector("position_sd_m", true, pose->position_sd_m);
    vector("axis", true, pose->axis);
    vector("ambient_t", pose->ambient_t.known, pose->ambient_t.value);
    vector("ambient_sd_t", pose->ambient_sd_t.known, pose->ambient_sd_t.value);
    printf("\"axis_sd_rad\": %.17g, \"remanence_t\": %.17g, \"remanence_sd_t\": %.17g, ", pose->axis_sd_rad,
           pose->remanence_t, pose->remanence_sd_t);
    printf("\"residual_t\": %.17g, \"chi2\": %.17g}", pose->residual_t, pose->chi2);
}

static void show_poses(const struct fmfts_poses *poses)
{
    for (int i = poses->count; i < FMFTS_MAX_MAGNETS; i++)
        if (poses->pose[i].known || !isnan(poses->pose[i].position_m[0]))
            abort();
    if (!poses->known && poses->count)
        abort();
    printf("\"poses\": %s", poses->known ? "[" : "null");
    for (int i = 0; i < poses->count; i++) {
        printf(i ? ", " : "");
        show_pose(&poses->pose[i]);
    }
    printf(poses->known ? "], " : ", ");
}

static void show_finger(const struct fmfts_finger *finger)
{
    printf("{");
    optional("shear_x_n", &finger->shear_x_n);
    optional("shear_x_sd_n", &finger->shear_x_sd_n);
    optional("shear_y_n", &finger->shear_y_n);
    optional("shear_y_sd_n", &finger->shear_y_sd_n);
    printf("\"x_m\": %.17g, \"x_sd_m\": %.17g, \"y_m\": %.17g, \"y_sd_m\": %.17g, ", finger->x_m, finger->x_sd_m,
           finger->y_m, finger->y_sd_m);
    printf("\"force_n\": %.17g, \"force_sd_n\": %.17g, \"id\": %" PRId64 "}", finger->force_n, finger->force_sd_n,
           finger->id);
}

static void show_fingers(const struct fmfts_fingers *fingers)
{
    for (int i = fingers->count; i < FMFTS_MAX_FINGERS; i++)
        if (!isnan(fingers->finger[i].force_n) || fingers->finger[i].shear_x_n.known)
            abort();
    if (!fingers->known && fingers->count)
        abort();
    printf("\"contacts\": %s", fingers->known ? "[" : "null");
    for (int i = 0; i < fingers->count; i++) {
        printf(i ? ", " : "");
        show_finger(&fingers->finger[i]);
    }
    printf(fingers->known ? "], " : ", ");
}

static void show_now(const char *name, const struct fmfts_now *now)
{
    if (!now->known) {
        if (!isnan(now->x_m.value) || !isnan(now->force_n.value) || now->force_n.known)
            abort();
        printf("\"%s\": null, ", name);
        return;
    }
    printf("\"%s\": {", name);
    optional("x_m", &now->x_m);
    optional("x_sd_m", &now->x_sd_m);
    optional("x_rate_m_per_s", &now->x_rate_m_per_s);
    optional("x_rate_sd_m_per_s", &now->x_rate_sd_m_per_s);
    optional("y_m", &now->y_m);
    optional("y_sd_m", &now->y_sd_m);
    optional("y_rate_m_per_s", &now->y_rate_m_per_s);
    optional("y_rate_sd_m_per_s", &now->y_rate_sd_m_per_s);
    optional("force_n", &now->force_n);
    optional("force_sd_n", &now->force_sd_n);
    optional("force_rate_n_per_s", &now->force_rate_n_per_s);
    optional("force_rate_sd_n_per_s", &now->force_rate_sd_n_per_s);
    optional("shear_x_n", &now->shear_x_n);
    optional("shear_x_sd_n", &now->shear_x_sd_n);
    optional("shear_x_rate_n_per_s", &now->shear_x_rate_n_per_s);
    optional("shear_x_rate_sd_n_per_s", &now->shear_x_rate_sd_n_per_s);
    optional("shear_y_n", &now->shear_y_n);
    optional("shear_y_sd_n", &now->shear_y_sd_n);
    optional("shear_y_rate_n_per_s", &now->shear_y_rate_n_per_s);
    optional("shear_y_rate_sd_n_per_s", &now->shear_y_rate_sd_n_per_s);
    printf("\"t_ns\": %" PRId64 "}, ", now->t_ns);
}

static void show_slip(const char *name, const struct fmfts_slip *slip)
{
    if (!slip->known) {
        if (!isnan(slip->speed_m_per_s.value) || slip->friction.known || slip->slipping.known)
            abort();
        printf("\"%s\": null, ", name);
        return;
    }
    printf("\"%s\": {", name);
    optional("sticking_probability", &slip->sticking_probability);
    optional("speed_m_per_s", &slip->speed_m_per_s);
    optional("speed_sd_m_per_s", &slip->speed_sd_m_per_s);
    optional("direction_rad", &slip->direction_rad);
    optional("direction_sd_rad", &slip->direction_sd_rad);
    optional("friction", &slip->friction);
    optional("friction_sd", &slip->friction_sd);
    optional("margin_n", &slip->margin_n);
    optional("margin_sd_n", &slip->margin_sd_n);
    printf("\"slipping\": %s}, ", !slip->slipping.known ? "null" : slip->slipping.value ? "true" : "false");
}

void show_contact(const struct fmfts_contact *contact)
{
    static const char *const touches[] = {"null", "false", "true"};
    show_text("pad", contact->pad);
    show_text("boot", contact->boot);
    integer("seq", contact->seq);
    integer("t_sample_ns", contact->t_sample_ns);
    integer("t_publish_ns", contact->t_publish_ns);
    integer("utc_ns", contact->utc_ns);
    optional("temperature_c", &contact->temperature_c);
    show_text("health", fmfts_health_name(contact->health));
    show_text("reason", contact->reason);
    printf("\"contact\": %s, ", touches[contact->contact]);
    optional("x_m", &contact->x_m);
    optional("x_sd_m", &contact->x_sd_m);
    optional("y_m", &contact->y_m);
    optional("y_sd_m", &contact->y_sd_m);
    optional("force_n", &contact->force_n);
    optional("force_sd_n", &contact->force_sd_n);
    optional("shear_x_n", &contact->shear_x_n);
    optional("shear_x_sd_n", &contact->shear_x_sd_n);
    optional("shear_y_n", &contact->shear_y_n);
    optional("shear_y_sd_n", &contact->shear_y_sd_n);
    printf("\"over_range\": %s, ", contact->over_range ? "true" : "false");
    optional("force_min_n", &contact->force_min_n);
    optional("displacement_m", &contact->displacement_m);
    optional("displacement_sd_m", &contact->displacement_sd_m);
    show_fingers(&contact->contacts);
    printf("\"more\": %s, ", !contact->more.known ? "null" : contact->more.value ? "true" : "false");
    show_now("now", &contact->now);
    show_slip("slip", &contact->slip);
    printf("\"pose\": ");
    show_pose(&contact->pose);
    printf(", ");
    show_poses(&contact->poses);
    integer("sensors_ok", contact->sensors_ok);
    show_text("model", contact->model);
    if (contact->baseline.known)
        show_text("baseline", contact->baseline.value);
    else
        printf("\"baseline\": null, ");
    printf("\"measured\": %s, ", fmfts_measured(contact) ? "true" : "false");
}
