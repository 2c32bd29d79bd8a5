// A pad with a baseline and a contact model, whose numbers are only plausible: the target checks that nothing else is
// read or written, and that every published number is one.
#ifndef FMFTS_MADE_PAD_H
#define FMFTS_MADE_PAD_H

#include <math.h>
#include <string.h>

#include "../../daemon/fmfts/pipeline/frame.h"
#include "../../daemon/fmfts/pose/model.h"

enum { HIDDEN = 6, OUTPUTS = 3, WEIGHTS = (10 + HIDDEN + OUTPUTS) * HIDDEN };
enum { NETWORK = 3 + 6 + 30 + WEIGHTS + 2 * HIDDEN + OUTPUTS };
enum { CAUSES = 3 };
enum { KNOTS = 3, TABLE = 9 + (KNOTS + 2) * (KNOTS + 2) * FMFTS_MOVED, SIGHTING = 7 + 36 + 1 + 7 + 2 };

// Differences between pads: bits of an input's first byte.
enum { CONSTANT = 1, BARE_ALONE = 2, WITHOUT_MODEL = 4, BESIDE_STEEL = 8 };
enum { SMOOTHED = 16, FELT = 32, WITHOUT_BASELINE = 64, EIGHT = 128 };

typedef struct {
    fmfts_parameters parameters;
    float network[NETWORK];
    double errors[CAUSES * FMFTS_CHANGE * FMFTS_AXES], response[TABLE + 1], own[SIGHTING], other[SIGHTING];
    fmfts_memory memory;
    fmfts_pad pad;
} made_pad;

static const double NOISE_T = 2e-7, STEP_T = 1e-7, PERIOD_US = 4545.0;

static void fill(double *numbers, size_t count, double value)
{
    for (size_t i = 0; i < count; i++)
        numbers[i] = value;
}

// What a sensor reads of the pad's magnet at rest, moved by `moved_m`.
static inline void field_at(const fmfts_pose_parameters *p, int sensor, const double moved_m[3], double field_t[3])
{
    double position[3];
    fmfts_sight sight;
    for (int i = 0; i < 3; i++)
        position[i] = p->rest[i] + moved_m[i];
    fmfts_source source = {.position = position, .axis = p->rest + AXIS_VALUE, .strength = p->strength_t_m3};
    look(&source, p->place_m + 3 * sensor, &sight);
    for (int i = 0; i < 3; i++)
        field_t[i] = sight.alpha * source.axis[i] + sight.beta * sight.r[i];
}

static void make_sensors(fmfts_pose_parameters *p, int sensors)
{
    const double none[3] = {0.0};
    p->sensors = sensors;
    p->saturated_count = -4096.0;
    p->largest_count = 2047.0;
    p->period_us = PERIOD_US;
    p->at_zero_c = p->c_per_count = NAN;
    fill(p->step_t, sizeof p->step_t / sizeof *p->step_t, STEP_T);
    fill(p->repeats_allowed, FMFTS_AXES, 30.0);
    fill(p->gain, FMFTS_AXES, 1.0);
    fill(p->noise_t, FMFTS_AXES, NOISE_T);
    fill(p->sensitivity_deviation, 3 * FMFTS_AXES, 1e-3);
    fill(p->place_deviation, FMFTS_SENSORS, 1e-3);
    p->systematic_t = 2e-8;
    p->offset_t_per_k = 1e-8;
    for (int i = 0; i < sensors; i++) {
        double reach = i < 4 ? 8e-3 : 11e-3;
        p->place_m[3 * i] = i < 4 ? (i & 1 ? reach : -reach) : i & 1 ? 0.0 : (i & 2 ? reach : -reach);
        p->place_m[3 * i + 1] = i < 4 ? (i & 2 ? reach : -reach) : i & 1 ? (i & 2 ? reach : -reach) : 0.0;
        for (int axis = 0; axis < 3; axis++)
            p->direction[9 * i + 4 * axis] = 1.0;
        field_at(p, i, none, p->rest_field_t + 3 * i);
    }
}

static void make_magnet(fmfts_pose_parameters *p, uint8_t kind)
{
    p->strength_t_m3 = 6.15e-11;
    p->rest[2] = 12e-3;
    p->rest[5] = 1.0;
    for (int c = 0; c < FMFTS_STEP; c++) {
        bool is_ambient = c >= AMBIENT_COLUMN && c < GRADIENT_COLUMN;
        p->part[c] = c < LOG_COLUMN ? FMFTS_FREE : is_ambient && !(kind & CONSTANT) ? FMFTS_PRIOR : FMFTS_FIXED;
        p->walk_per_s[c] = is_ambient ? 1e-9 : 1e-6;
    }
    p->part[LOG_COLUMN] = kind & CONSTANT ? FMFTS_PRIOR : FMFTS_CONSIDERED;
    p->moment_per_k = -1e-3;
    p->moment_per_k_deviation = 2e-4;
    p->rest_temperature_c = 25.0;
    p->unread_warming_k = 5.0;
}

static void make_gates(fmfts_pose_parameters *p, uint8_t kind)
{
    for (int freedom = 0; freedom <= FMFTS_AXES; freedom++) {
        double wide = freedom + 12.0 + 7.0 * sqrt(freedom);
        p->gate_chi2[freedom] = p->alarm_chi2[freedom] = freedom ? wide : NAN;
        p->motion_chi2[freedom] = p->sound_chi2[freedom] = freedom ? freedom + 4.0 + 3.0 * sqrt(freedom) : NAN;
    }
    p->at_rest = kind & BARE_ALONE ? 0.0 : 1.0;
    p->steel_nearby = kind & BESIDE_STEEL ? 1.0 : 0.0;
    p->leftovers = p->ambient_errors = 3.0;
    fill(p->change_error, 5 * FMFTS_CHANGE * 3, 1e-3);
    fill(p->ambient_error, 3 * FMFTS_CHANGE * 3, 1e-3);
    p->silicone_share = p->creep_share = 0.05;
    p->unseen_gap_s = 0.025;
    fill(p->creep_time_s, FMFTS_DECADES, 1.0);
    p->reference_t[0] = p->reference_strength_t = 5e-5;
    p->even_t = 1e-6;
    p->healthy_deviations = 3.0;
    p->strongest_foreign_t = 2e-5;
    fill(p->unit_gradient, 25, 0.0);
    for (int i = 0; i < 5; i++)
        p->unit_gradient[6 * i] = i < 3 ? 1e-4 : 10.0;
    p->drawn_rest_m[2] = p->rest[2];
    p->drawn_turn[0] = p->drawn_turn[4] = p->drawn_turn[8] = 1.0;
    p->pad_turn[0] = p->pad_turn[4] = p->pad_turn[8] = 1.0;
}

static void make_contact(made_pad *made, uint8_t kind)
{
    fmfts_contact_parameters *p = &made->parameters.contact;
    p->onset_chi2 = 45.0;
    p->release_chi2 = 15.0;
    p->longest_gap_s = 0.025;
    p->refine_steps = 2.0;
    p->least_variance = 1e-12;
    p->model_rest[2] = 12.0;
    p->model_rest[5] = 1.0;
    for (int i = 0; i < 6; i++) {
        p->lowest[i] = p->model_rest[i] - (i < 3 ? 1.0 : 0.3);
        p->highest[i] = p->model_rest[i] + (i < 3 ? 1.0 : 0.3);
    }
    p->outside_deviations = 3.0;
    p->trained_top_mm = 12.0;
    p->force_max_n = 2.0;
    p->edges_m[0] = p->edges_m[2] = -9e-3;
    p->edges_m[1] = p->edges_m[3] = 9e-3;
    fill(p->spread_m, 2, 5e-3);
    p->force_bins = p->radius_bins = FMFTS_BINS;
    for (int i = 0; i < FMFTS_BINS; i++) {
        p->force_bin_n[i] = 0.2 * i;
        p->radius_bin_m[i] = 1e-3 * i;
    }
    fill(p->own_deviation, sizeof p->own_deviation / sizeof *p->own_deviation, 1e-2);
    fill(p->trained_force_n, FMFTS_BINS * FMFTS_BINS, 1e-2);
    p->smoothing_s = kind & SMOOTHED ? 0.02 : 0.0;
    p->smoothing_jump_chi2 = 20.0;
    made->network[0] = HIDDEN;
    made->network[1] = OUTPUTS;
    made->network[2] = 0.05f;
    for (int i = 3; i < NETWORK; i++)
        made->network[i] = 0.3f * sinf((float)i);
    made->network[5] = 12.0f; // where it rests: 12 mm above the board
}

// The pad sinks by 0.4 mm under 1 N, and tilts towards the finger.
static size_t make_response(double *table)
{
    const double head[9] = {KNOTS, KNOTS, 1.0, 1.0, -9.0, -9.0, 9.0, 9.0, 1.0};
    memcpy(table, head, sizeof head);
    for (int x = 0; x < KNOTS + 2; x++) {
        for (int y = 0; y < KNOTS + 2; y++) {
            const double moved[FMFTS_MOVED] = {0.05 * (x - 2), 0.05 * (y - 2), -0.4, 0.02 * (x - 2), 0.02 * (y - 2)};
            memcpy(table + 9 + ((KNOTS + 2) * x + y) * FMFTS_MOVED, moved, sizeof moved);
        }
    }
    const int32_t exponent = 1;
    memcpy(table + TABLE, &exponent, sizeof exponent);
    return TABLE * sizeof(double) + sizeof exponent;
}

static void make_now(fmfts_parameters *p)
{
    p->now.tells_now = 1.0;
    p->now.lead_us = 1500.0;
    p->now.early_lead_us = 1000.0;
    for (int i = 0; i < FMFTS_MOVED; i++) {
        p->now.to_pose[6 * i] = i < 3 ? 1e-3 : 1.0;
        p->now.untouched_drive[6 * i] = i < 3 ? 1e-3 : 100.0;
    }
    fill(p->now.drive_power, FMFTS_CONTACT, 1e3);
    p->motion.weights[0] = p->motion.weights[1] = 1.0;
    p->motion.surprise_chi2 = 60.0;
    p->motion.early_chi2 = 31.0;
    p->message.remanence_t = 1.2;
    fill(p->message.rest_variance, 6, 1e-10);
    p->message.detection_limit_n = 0.05;
}

static fmfts_sighting sighting_of(double *numbers, const double *rest)
{
    memcpy(numbers, rest, 7 * sizeof *numbers);
    memcpy(numbers + 44, rest, 7 * sizeof *numbers);
    numbers[43] = NAN;
    return (fmfts_sighting){1, numbers, numbers + 7, numbers + 43, numbers + 44, numbers + 51};
}

static void make_memory(const fmfts_pose_parameters *p, fmfts_memory *memory)
{
    memset(memory, 0, sizeof *memory);
    fill(memory->pose.field_t, 3 * FMFTS_AXES, NAN);
    memory->pose.last_us = NAN;
    memory->pose.misfit = memory->pose.lasting_misfit = 1.0;
    memory->pose.sound = 1;
    memory->pose.found_sensor = -1;
    fill(memory->pose.lowest_t, 3, INFINITY);
    fill(memory->pose.highest_t, 3, -INFINITY);
    fill(memory->motion.modes, 2, 0.5);
    fill(memory->motion.early_widths, 2, 1.0);
    memcpy(memory->pose.state, p->rest, sizeof p->rest);
    for (int c = 0; c < FMFTS_STEP; c++) {
        double of_field = c < GRADIENT_COLUMN ? 1e-10 : 1e-6;
        memory->pose.covariance[(FMFTS_STEP + 1) * c] = c < 3 ? 1e-8 : c < AMBIENT_COLUMN ? 1e-4 : of_field;
    }
    memory->pose.unread_variance = 2.5e-5;
}

static void make_pad(uint8_t kind, made_pad *made)
{
    static const char *const words = "for a person";
    memset(made, 0, sizeof *made);
    fmfts_pose_parameters *p = &made->parameters.pose;
    make_magnet(p, kind);
    make_sensors(p, kind & EIGHT ? 8 : 4);
    make_gates(p, kind);
    make_contact(made, kind);
    make_now(&made->parameters);
    made->parameters.message.has_baseline = kind & WITHOUT_BASELINE ? 0.0 : 1.0;
    made->parameters.message.has_model = kind & (WITHOUT_MODEL | BARE_ALONE) ? 0.0 : 1.0;
    p->neighbours = kind & FELT ? 1.0 : 0.0;
    p->neighbour_magnets[0] = 1.0;
    p->neighbour_turn[0] = p->neighbour_turn[4] = p->neighbour_turn[8] = 1.0;
    p->neighbour_place_m[0] = 30e-3;
    p->neighbour_placement_m[0] = 1e-4;
    p->neighbour_magnet[0] = p->strength_t_m3;
    made->pad = (fmfts_pad){.parameters = &made->parameters, .response = made->response};
    made->pad.errors = (fmfts_field_errors){3 * (size_t)p->sensors, CAUSES, made->errors};
    fill(made->errors, sizeof made->errors / sizeof *made->errors, 1e-4);
    made->pad.response_bytes = make_response(made->response);
    require(fmfts_view_network(made->network, NETWORK, &made->pad.network), "the network is one");
    made->pad.words = (fmfts_words){1, "pad", "boot", "model", "baseline", words, words, words, {.untellable = words}};
    for (int i = 0; i < FMFTS_GAIN_CODES; i++)
        made->pad.words.chip.saturated[i] = words;
    made->pad.own = sighting_of(made->own, p->rest);
    made->pad.neighbour[0] = sighting_of(made->other, p->rest);
    make_memory(p, &made->memory);
}

#endif
