/* The effect of fingers on the field: field_model.py explains it. */
#include <string.h>

#include "../arithmetic/matrix.h"
#include "several.h"

void fmfts_moved_magnets(const fmfts_several *model, const double *change, double *position, double *axis)
{
    for (size_t m = 0; m < model->magnets; m++) {
        fmfts_move_magnet(model->frame + 9 * m, model->position + 3 * m, change + FMFTS_POSE_CHANGE * m, position + 3 * m,
                          axis + 3 * m);
    }
}

void fmfts_changed_field(const fmfts_several *model, const double *change, double *field, double *slope)
{
    double position[3 * FMFTS_SEVERAL_MAGNETS], axis[3 * FMFTS_SEVERAL_MAGNETS];
    fmfts_moved_magnets(model, change, position, axis);
    fmfts_fields(&(fmfts_together){model->magnets, model->sensors, position, axis, model->frame, model->strength, model->octupole,
                                   model->place, model->axes},
                 field, slope);
    for (size_t v = 0; v < model->values; v++) {
        field[v] -= model->at_rest[v];
    }
}

static bool is_of(const fmfts_predicted *predicted, fmfts_fingers fingers, fmfts_known wanted)
{
    bool same = predicted->known >= wanted && predicted->fingers == fingers.count;
    for (size_t i = 0; same && i < FMFTS_FINGER * fingers.count; i++) {
        same = predicted->of[i] == fingers.at[i];
    }
    return same;
}

int fmfts_predict_in(const fmfts_several *model, fmfts_fingers fingers, fmfts_several_work *work)
{
    int own = is_of(&work->predicted[1], fingers, FMFTS_ALL_OF_IT);
    fmfts_predict(model, fingers, FMFTS_ALL_OF_IT, &work->predicted[own]);
    return own;
}

void fmfts_predict(const fmfts_several *model, fmfts_fingers fingers, fmfts_known wanted, fmfts_predicted *predicted)
{
    if (is_of(predicted, fingers, wanted)) {
        return;
    }
    predicted->known = fingers.count ? wanted : FMFTS_ALL_OF_IT;
    predicted->fingers = fingers.count;
    for (size_t i = 0; i < FMFTS_FINGER * fingers.count; i++) {
        predicted->of[i] = fingers.at[i];
    }
    size_t poses = model->poses, unknowns = FMFTS_FINGER * fingers.count;
    double by_finger[FMFTS_SEVERAL_POSES * FMFTS_SEVERAL_UNKNOWNS], *change = predicted->change;
    memset(change, 0, poses * sizeof(double));
    if (!fingers.count) {
        memset(predicted->field, 0, model->values * sizeof(double));
        memcpy(predicted->by_pose, model->rest_slope, model->values * poses * sizeof(double));
        return;
    }
    for (size_t f = 0; f < fingers.count; f++) {
        double *pressed = predicted->pressed[f], *slope = pressed + poses;
        fmfts_press_by_table(&model->table, fingers.at + FMFTS_FINGER * f, wanted == FMFTS_ALL_OF_IT, pressed);
        for (size_t p = 0; p < poses; p++) {
            const double *off = model->off_mm + 2 * (p / FMFTS_POSE_CHANGE);
            double shifted = slope[3 * p] * off[0] + slope[3 * p + 1] * off[1];
            change[p] = change[p] + pressed[p] - shifted;
            for (size_t i = 0; i < FMFTS_FINGER; i++) {
                by_finger[p * unknowns + FMFTS_FINGER * f + i] =
                    slope[3 * p + i] * model->head->unit[p % FMFTS_POSE_CHANGE];
            }
        }
    }
    for (size_t p = 0; p < poses; p++) {
        change[p] *= model->head->unit[p % FMFTS_POSE_CHANGE];
    }
    fmfts_changed_field(model, change, predicted->field, wanted == FMFTS_FIELD_ALONE ? NULL : predicted->by_pose);
    if (wanted == FMFTS_FIELD_ALONE) {
        return;
    }
    fmfts_product(model->values, poses, unknowns, predicted->by_pose, by_finger, predicted->slope);
}
