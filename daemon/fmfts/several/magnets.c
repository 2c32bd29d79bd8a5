/* The field of all magnets, and its derivatives: pose/magnets.py explains them. */
#include <math.h>
#include <string.h>

#include "../pose/model.h"
#include "several.h"

/* A magnet after its change of pose; by_tilt: derivative of its axis by the axis's x and y at rest. */
typedef struct {
    double position[3], axis[3], by_tilt[3][2], strength, octupole;
} source;

static source moved(const fmfts_several *model, size_t magnet, const double *change)
{
    const double *frame = model->frame + 9 * magnet;
    double square = change[3] * change[3] + change[4] * change[4], left = 1.0 - square;
    double local[3] = {change[3], change[4], sqrt(left > 0.0 ? left : 0.0)}, back[3];
    source one = {.strength = model->strength[magnet], .octupole = model->octupole[magnet]};
    for (int i = 0; i < 3; i++) {
        one.position[i] = model->position[3 * magnet + i] + change[i];
        one.axis[i] = dot3(frame + 3 * i, local);
    }
    for (int i = 0; i < 3; i++) {
        double column[3] = {frame[i], frame[3 + i], frame[6 + i]};
        back[i] = dot3(column, one.axis);
    }
    double upright = 1e-3 > back[2] ? 1e-3 : back[2];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 2; j++) {
            one.by_tilt[i][j] = frame[3 * i + j] - frame[3 * i + 2] * (back[j] / upright);
        }
    }
    return one;
}

void fmfts_moved_magnet(const fmfts_several *model, size_t magnet, const double *change, double position[3], double axis[3])
{
    source one = moved(model, magnet, change + FMFTS_POSE_CHANGE * magnet);
    memcpy(position, one.position, sizeof one.position);
    memcpy(axis, one.axis, sizeof one.axis);
}

/* Field [3] of one magnet at `place`, and its slope by the five numbers of its change: slope[i · stride + 0 … 4]. */
static void look_at(const source *one, const double *place, double field[3], double *slope, size_t stride)
{
    double by_position[3][3], by_axis[3][3];
    fmfts_sight sight;
    fmfts_source magnet = {
        .position = one->position, .axis = one->axis, .strength = one->strength, .octupole = one->octupole};
    look(&magnet, place, &sight);
    differentiate(&magnet, &sight, field, by_position, by_axis);
    for (int i = 0; i < 3; i++) {
        memcpy(slope + (size_t)i * stride, by_position[i], sizeof by_position[i]);
        for (int j = 0; j < 2; j++) {
            double column[3] = {one->by_tilt[0][j], one->by_tilt[1][j], one->by_tilt[2][j]};
            slope[(size_t)i * stride + 3 + (size_t)j] = dot3(by_axis[i], column);
        }
    }
}

void fmfts_fields(const fmfts_several *model, const double *change, double *field, double *slope)
{
    source sources[FMFTS_SEVERAL_MAGNETS];
    double in_pad[3][FMFTS_SEVERAL_POSES];
    size_t poses = model->poses;
    for (size_t magnet = 0; magnet < model->magnets; magnet++) {
        sources[magnet] = moved(model, magnet, change + FMFTS_POSE_CHANGE * magnet);
    }
    for (size_t sensor = 0; sensor < model->sensors; sensor++) {
        const double *axes = model->axes + 9 * sensor;
        double total[3] = {0.0, 0.0, 0.0};
        for (size_t magnet = 0; magnet < model->magnets; magnet++) {
            double own[3];
            look_at(&sources[magnet], model->place + 3 * sensor, own, in_pad[0] + FMFTS_POSE_CHANGE * magnet,
                    FMFTS_SEVERAL_POSES);
            for (int i = 0; i < 3; i++) {
                total[i] = magnet ? total[i] + own[i] : own[i];
            }
        }
        for (int i = 0; i < 3; i++) {
            double along[3] = {axes[i], axes[3 + i], axes[6 + i]}, *row = slope + (3 * sensor + (size_t)i) * poses;
            field[3 * sensor + (size_t)i] = dot3(along, total);
            for (size_t p = 0; p < poses; p++) {
                double sum = 0.0;
                for (int k = 0; k < 3; k++) {
                    sum += along[k] * in_pad[k][p];
                }
                row[p] = sum;
            }
        }
    }
}
