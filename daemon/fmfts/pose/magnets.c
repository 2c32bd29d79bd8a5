/* The field of several magnets, and its slope by their poses. */
#include "magnets.h"

#include <math.h>
#include <string.h>

#include "model.h"

void fmfts_move_magnet(const double frame[9], const double rest[3], const double change[FMFTS_POSE_CHANGE], double position[3],
                       double axis[3])
{
    double square = change[3] * change[3] + change[4] * change[4], left = 1.0 - square;
    double local[3] = {change[3], change[4], sqrt(left > 0.0 ? left : 0.0)};
    for (int i = 0; i < 3; i++) {
        position[i] = rest[i] + change[i];
        axis[i] = dot3(frame + 3 * i, local);
    }
}

/* by_tilt: ∂axis/∂(m, n) = frame · (1, 0, −m/w; 0, 1, −n/w) for the axis's x and y in the frame, with w = √(1 − m² − n²). */
static void turn_by(const double frame[9], const double axis[3], double by_tilt[3][2])
{
    double back[3];
    for (int i = 0; i < 3; i++) {
        double column[3] = {frame[i], frame[3 + i], frame[6 + i]};
        back[i] = dot3(column, axis);
    }
    double upright = 1e-3 > back[2] ? 1e-3 : back[2];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 2; j++) {
            by_tilt[i][j] = frame[3 * i + j] - frame[3 * i + 2] * (back[j] / upright);
        }
    }
}

/* Field [3] of one magnet at `place`, and its slope by the five numbers of its change: slope[i · stride + 0 … 4].
 * NULL: not wanted. */
static void look_at(const fmfts_source *magnet, const double by_tilt[3][2], const double *place, double field[3], double *slope,
                    size_t stride)
{
    double by_position[3][3], by_axis[3][3];
    fmfts_sight sight;
    look(magnet, place, &sight);
    if (!slope) {
        dipole_field(magnet, &sight, field);
        return;
    }
    differentiate(magnet, &sight, field, by_position, by_axis);
    for (int i = 0; i < 3; i++) {
        memcpy(slope + (size_t)i * stride, by_position[i], sizeof by_position[i]);
        for (int j = 0; j < 2; j++) {
            double column[3] = {by_tilt[0][j], by_tilt[1][j], by_tilt[2][j]};
            slope[(size_t)i * stride + 3 + (size_t)j] = dot3(by_axis[i], column);
        }
    }
}

void fmfts_fields(const fmfts_together *together, double *field, double *slope)
{
    fmfts_source source[FMFTS_MOST_TOGETHER] = {{0}};
    double by_tilt[FMFTS_MOST_TOGETHER][3][2], in_pad[3][FMFTS_MOST_CHANGE];
    size_t poses = FMFTS_POSE_CHANGE * together->magnets;
    for (size_t m = 0; m < together->magnets; m++) {
        source[m].position = together->position + 3 * m;
        source[m].axis = together->axis + 3 * m;
        source[m].strength = together->strength[m];
        source[m].octupole = together->octupole[m];
        turn_by(together->frame + 9 * m, source[m].axis, by_tilt[m]);
    }
    for (size_t sensor = 0; sensor < together->sensors; sensor++) {
        const double *axes = together->axes + 9 * sensor;
        double total[3] = {0.0, 0.0, 0.0};
        for (size_t magnet = 0; magnet < together->magnets; magnet++) {
            double own[3];
            look_at(&source[magnet], (const double(*)[2])by_tilt[magnet], together->place + 3 * sensor, own,
                    slope ? in_pad[0] + FMFTS_POSE_CHANGE * magnet : NULL, FMFTS_MOST_CHANGE);
            for (int i = 0; i < 3; i++) {
                total[i] = magnet ? total[i] + own[i] : own[i];
            }
        }
        for (int i = 0; i < 3; i++) {
            double along[3] = {axes[i], axes[3 + i], axes[6 + i]};
            field[3 * sensor + (size_t)i] = dot3(along, total);
            for (size_t p = 0; slope && p < poses; p++) {
                double sum = 0.0;
                for (int k = 0; k < 3; k++) {
                    sum += along[k] * in_pad[k][p];
                }
                slope[(3 * sensor + (size_t)i) * poses + p] = sum;
            }
        }
    }
}
