/* Reads the arrays that field_model.py and fit.py have packed. */
#include <math.h>

#include "fit.h"

/* The next `count` doubles of a packed model. */
static const double *next(const double **at, size_t count)
{
    const double *here = *at;
    *at += count;
    return here;
}

static bool sizes_fit(const fmfts_several_head *head)
{
    return head->magnets >= 1.0 && head->magnets <= FMFTS_SEVERAL_MAGNETS && head->sensors >= 1.0 &&
           head->sensors <= FMFTS_SEVERAL_SENSORS && head->causes >= 0.0 &&
           head->causes <= FMFTS_SEVERAL_CAUSES && head->width >= 4.0 && head->width <= 10000.0 &&
           head->terms >= 1.0 && head->terms <= FMFTS_SEVERAL_TERMS && isfinite(head->first_mm) &&
           head->spacing_mm > 0.0 && isfinite(head->spacing_mm);
}

bool fmfts_view_several(const double *packed, size_t count, fmfts_several *model)
{
    const fmfts_several_head *head = (const fmfts_several_head *)packed;
    const size_t numbers = sizeof *head / sizeof(double);
    if (count < numbers || !sizes_fit(head)) {
        return false;
    }
    size_t magnets = (size_t)head->magnets, sensors = (size_t)head->sensors, causes = (size_t)head->causes;
    size_t width = (size_t)head->width, terms = (size_t)head->terms;
    size_t values = 3 * sensors, poses = FMFTS_POSE_CHANGE * magnets;
    size_t stride = (values + FMFTS_LANES - 1) / FMFTS_LANES * FMFTS_LANES;
    const double *at = packed + numbers;
    *model = (fmfts_several){
        .head = head,
        .magnets = magnets,
        .sensors = sensors,
        .causes = causes,
        .values = values,
        .poses = poses,
        .stride = stride,
    };
    model->position = next(&at, 3 * magnets);
    model->strength = next(&at, magnets);
    model->octupole = next(&at, magnets);
    model->frame = next(&at, 9 * magnets);
    model->place = next(&at, 3 * sensors);
    model->axes = next(&at, 9 * sensors);
    model->at_rest = next(&at, values);
    model->rest_slope = next(&at, values * poses);
    model->by_ambient = next(&at, 3 * stride);
    model->off_mm = next(&at, 2 * magnets);
    model->off_root = next(&at, 4 * magnets * magnets);
    model->by_pose = next(&at, poses * causes * stride);
    model->by_field = next(&at, 3 * causes * stride);
    model->table = (fmfts_press_table){.width = width,
                                       .terms = terms,
                                       .poses = poses,
                                       .first_mm = head->first_mm,
                                       .spacing_mm = head->spacing_mm,
                                       .scale_n = head->scale_n,
                                       .table = next(&at, width * width * (terms + 2) * poses)};
    return (size_t)(at - packed) == count;
}

bool fmfts_view_search(const double *packed, size_t count, size_t values, fmfts_search *search)
{
    const fmfts_search_head *head = (const fmfts_search_head *)packed;
    const size_t numbers = sizeof *head / sizeof(double);
    if (count < numbers || !(head->places >= 1.0 && head->places <= FMFTS_SEVERAL_PLACES)) {
        return false;
    }
    size_t places = (size_t)head->places, panels = (places + FMFTS_PANEL - 1) / FMFTS_PANEL;
    size_t padded = panels * FMFTS_PANEL;
    *search = (fmfts_search){
        .head = head,
        .places = places,
        .panels = panels,
        .values = values,
        .x_mm = packed + numbers,
        .y_mm = packed + numbers + padded,
        .template_t = packed + numbers + 2 * padded,
    };
    return count == numbers + (2 + values) * padded;
}
