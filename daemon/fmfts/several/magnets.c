/* The field of all magnets, and its derivatives: magnets.py and dipole.py of pose/ explain them. */
#include <math.h>
#include <string.h>

#include "several.h"

/* A magnet after its change of pose; by_tilt: derivative of its axis by the axis's x and y at rest. */
typedef struct {
    double position[3], axis[3], by_tilt[3][2], strength, octupole;
} source;

/* α and β of dipole.py, times the strength, and their derivatives by u and twice those by q. */
typedef struct {
    double alpha, beta, alpha_u, beta_u, alpha_2q, beta_2q;
} radial;

static double dot(const double *a, const double *b)
{
    double sum = 0.0;
    for (int i = 0; i < 3; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

static source moved(const fmfts_several *model, size_t magnet, const double *change)
{
    const double *frame = model->frame + 9 * magnet;
    double square = change[3] * change[3] + change[4] * change[4], left = 1.0 - square;
    double local[3] = {change[3], change[4], sqrt(left > 0.0 ? left : 0.0)}, back[3];
    source one = {.strength = model->strength[magnet], .octupole = model->octupole[magnet]};
    for (int i = 0; i < 3; i++) {
        one.position[i] = model->position[3 * magnet + i] + change[i];
        one.axis[i] = dot(frame + 3 * i, local);
    }
    for (int i = 0; i < 3; i++) {
        double column[3] = {frame[i], frame[3 + i], frame[6 + i]};
        back[i] = dot(column, one.axis);
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

static radial radial_of(const source *one, double u, double q)
{
    double inverse = 1.0 / q, third = inverse * sqrt(inverse), fifth = third * inverse, b = one->strength;
    radial found = {-third, 3.0 * u * fifth, 0.0 * u, 3.0 * fifth, 3.0 * fifth, -15.0 * u * fifth * inverse};
    if (one->octupole != 0.0) {
        double scaled = one->octupole * fifth, w = u * inverse, uw = u * w;
        found.alpha += scaled * (1.5 - 7.5 * uw);
        found.beta += scaled * w * (17.5 * uw - 7.5);
        found.alpha_u += scaled * -15.0 * w;
        found.beta_u += scaled * inverse * (52.5 * uw - 7.5);
        found.alpha_2q += scaled * inverse * (52.5 * uw - 7.5);
        found.beta_2q += scaled * inverse * w * (52.5 - 157.5 * uw);
    }
    return (radial){b * found.alpha,  b * found.beta,     b * found.alpha_u,
                    b * found.beta_u, b * found.alpha_2q, b * found.beta_2q};
}

/* Field [3] of one magnet at `place`, and its slope by the five numbers of its change: slope[i · stride + 0 … 4]. */
static void look(const source *one, const double *place, double field[3], double *slope, size_t stride)
{
    double r[3], by_axis[3];
    for (int i = 0; i < 3; i++) {
        r[i] = place[i] - one->position[i];
    }
    radial v = radial_of(one, dot(r, one->axis), r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
    for (int i = 0; i < 3; i++) {
        double by_u = v.alpha_u * one->axis[i] + v.beta_u * r[i], by_2q = v.alpha_2q * one->axis[i] + v.beta_2q * r[i];
        field[i] = v.alpha * one->axis[i] + v.beta * r[i];
        for (int j = 0; j < 3; j++) {
            double same = i == j ? 1.0 : 0.0;
            slope[i * stride + j] = -(by_u * one->axis[j] + by_2q * r[j] + v.beta * same);
            by_axis[j] = by_u * r[j] + v.alpha * same;
        }
        for (int j = 0; j < 2; j++) {
            double sum = 0.0;
            for (int k = 0; k < 3; k++) {
                sum += by_axis[k] * one->by_tilt[k][j];
            }
            slope[i * stride + 3 + j] = sum;
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
            look(&sources[magnet], model->place + 3 * sensor, own, in_pad[0] + FMFTS_POSE_CHANGE * magnet,
                 FMFTS_SEVERAL_POSES);
            for (int i = 0; i < 3; i++) {
                total[i] = magnet ? total[i] + own[i] : own[i];
            }
        }
        for (int i = 0; i < 3; i++) {
            double along[3] = {axes[i], axes[3 + i], axes[6 + i]}, *row = slope + (3 * sensor + (size_t)i) * poses;
            field[3 * sensor + (size_t)i] = dot(along, total);
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
