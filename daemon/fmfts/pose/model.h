/* The field of a magnet (dipole.py has the equation), and the measurement model: what one scalar reads in a state. */
#ifndef FMFTS_MODEL_H
#define FMFTS_MODEL_H

#include <math.h>

#include "../arithmetic/elementary.h"
#include "algebra.h"

/* A measurement in units of its deviation. shares_place: 1 if it has the place of the row before, so that the magnets' sight
 * from there need not be computed again. Nine doubles: FMFTS_WORK. */
typedef struct {
    double place[3];
    double direction[3];
    double value;
    double deviation;
    double shares_place;
} fmfts_row;

typedef struct {
    const double *position;
    const double *axis;
    double basis[2][3];
    double strength;
    double octupole;
} fmfts_source;

/* A magnet as seen from a place: r, and α, β and their derivatives (dipole.py) times the strength. */
typedef struct {
    double r[3];
    double basis_r[2];
    double alpha, beta, alpha_u, beta_u, alpha_2q, beta_2q;
} fmfts_sight;

FMFTS_INLINE double dot3(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Duff et al., JCGT 6 (2017): see tangent_basis in state.py. */
FMFTS_INLINE void tangent_basis(const double *axis, double basis[2][3])
{
    double x = axis[0], y = axis[1], z = axis[2], sign = z >= 0.0 ? 1.0 : -1.0;
    double a = -1.0 / (sign + z), b = x * y * a;
    basis[0][0] = 1.0 + sign * x * x * a;
    basis[0][1] = sign * b;
    basis[0][2] = -sign * x;
    basis[1][0] = b;
    basis[1][1] = sign + y * y * a;
    basis[1][2] = -y;
}

FMFTS_INLINE void look(const fmfts_source *source, const double *place, fmfts_sight *sight)
{
    double *r = sight->r;
    for (int i = 0; i < 3; i++) {
        r[i] = place[i] - source->position[i];
    }
    double inverse = 1.0 / dot3(r, r), u = dot3(source->axis, r), w = u * inverse;
    double third = source->strength * inverse * sqrt(inverse), fifth = third * inverse;
    sight->basis_r[0] = dot3(source->basis[0], r);
    sight->basis_r[1] = dot3(source->basis[1], r);
    sight->alpha = -third;
    sight->beta = 3.0 * third * w;
    sight->alpha_u = 0.0;
    sight->beta_u = 3.0 * fifth;
    sight->alpha_2q = 3.0 * fifth;
    sight->beta_2q = -15.0 * fifth * w;
    if (source->octupole != 0.0) {
        double scaled = source->octupole * fifth, further = scaled * inverse, uw = u * w;
        sight->alpha += scaled * (1.5 - 7.5 * uw);
        sight->beta += scaled * w * (17.5 * uw - 7.5);
        sight->alpha_u = -15.0 * scaled * w;
        sight->beta_u += further * (52.5 * uw - 7.5);
        sight->alpha_2q += further * (52.5 * uw - 7.5);
        sight->beta_2q += further * w * (52.5 - 157.5 * uw);
    }
}

FMFTS_INLINE void dipole_field(const fmfts_source *source, const fmfts_sight *sight, double field[3])
{
    for (int i = 0; i < 3; i++) {
        field[i] = sight->alpha * source->axis[i] + sight->beta * sight->r[i];
    }
}

/* The field along `direction` of a dipole of `strength` at its place, by each component of its moment's direction: without the octupole the
 * field is linear in these. */
FMFTS_INLINE void by_moment(double strength, const double *r, const double *direction, double by_component[3])
{
    double inverse = 1.0 / dot3(r, r), third = strength * inverse * sqrt(inverse);
    double across = 3.0 * dot3(r, direction) * inverse;
    for (int i = 0; i < 3; i++) {
        by_component[i] = third * (across * r[i] - direction[i]);
    }
}

/* The field, and its derivatives by the magnet's position and by the direction of its moment. */
FMFTS_INLINE void differentiate(const fmfts_source *source, const fmfts_sight *sight, double field[3], double by_position[3][3],
                                double by_axis[3][3])
{
    dipole_field(source, sight, field);
    for (int i = 0; i < 3; i++) {
        double by_u = sight->alpha_u * source->axis[i] + sight->beta_u * sight->r[i];
        double by_2q = sight->alpha_2q * source->axis[i] + sight->beta_2q * sight->r[i];
        for (int j = 0; j < 3; j++) {
            by_position[i][j] = -(by_u * source->axis[j] + by_2q * sight->r[j] + (i == j ? sight->beta : 0.0));
            by_axis[i][j] = by_u * sight->r[j] + (i == j ? sight->alpha : 0.0);
        }
    }
}

/* Returns the field along `direction`. column[6]: its derivatives by position, tilt and log moment. */
FMFTS_INLINE double sense(const fmfts_source *source, const fmfts_sight *sight, const double *direction, double *column)
{
    double along = dot3(source->axis, direction), across = dot3(sight->r, direction);
    double by_u = sight->alpha_u * along + sight->beta_u * across;
    double by_2q = sight->alpha_2q * along + sight->beta_2q * across;
    for (int i = 0; i < 3; i++) {
        column[i] = -(by_u * source->axis[i] + by_2q * sight->r[i] + sight->beta * direction[i]);
    }
    column[3] = by_u * sight->basis_r[0] + sight->alpha * dot3(source->basis[0], direction);
    column[4] = by_u * sight->basis_r[1] + sight->alpha * dot3(source->basis[1], direction);
    column[5] = sight->alpha * along + sight->beta * across;
    return column[5];
}

/* Returns what the gradient of the ambient field adds along `direction`. column[5]: its derivatives. */
FMFTS_INLINE double sense_gradient(const double *gradient, const double *place, const double *direction, double *column)
{
    column[0] = direction[0] * place[0] - direction[2] * place[2];
    column[1] = direction[0] * place[1] + direction[1] * place[0];
    column[2] = direction[0] * place[2] + direction[2] * place[0];
    column[3] = direction[1] * place[1] - direction[2] * place[2];
    column[4] = direction[1] * place[2] + direction[2] * place[1];
    double sum = 0.0;
    for (int i = 0; i < 5; i++) {
        sum += column[i] * gradient[i];
    }
    return sum;
}

/* The first value and the first column of a magnet. The ambient field is between the first magnet and the others. */
FMFTS_INLINE size_t first_value(size_t magnet)
{
    return magnet == 0 ? 0 : 8 + 7 * magnet;
}

FMFTS_INLINE size_t first_column(size_t magnet)
{
    return magnet == 0 ? 0 : 8 + 6 * magnet;
}

enum { AXIS_VALUE = 3, LOG_VALUE = 6, AMBIENT_VALUE = 7, GRADIENT_VALUE = 10 };
enum { TILT_COLUMN = 3, LOG_COLUMN = 5, AMBIENT_COLUMN = 6, GRADIENT_COLUMN = 9, BASE_COLUMNS = 14 };

/* The magnets of a state, prepared for look(). log_moment: the logarithm of `strength`, kept to spare the exponential.
 * with_gradient: whether the state's ambient field has a gradient that counts. */
typedef struct {
    fmfts_source source[FMFTS_MAX_MAGNETS];
    double log_moment[FMFTS_MAX_MAGNETS];
    size_t count;
    bool with_gradient;
} fmfts_sources;

FMFTS_INLINE void place_sources(const double *magnets, const double *state, fmfts_sources *sources)
{
    for (size_t m = 0; m < sources->count; m++) {
        const double *own = state + first_value(m);
        fmfts_source *source = &sources->source[m];
        source->position = own;
        source->axis = own + AXIS_VALUE;
        tangent_basis(source->axis, source->basis);
        if (own[LOG_VALUE] != sources->log_moment[m]) {
            sources->log_moment[m] = own[LOG_VALUE];
            source->strength = magnets[FMFTS_MAGNET * m] * fmfts_exp(own[LOG_VALUE]);
        }
        source->octupole = magnets[FMFTS_MAGNET * m + 1];
    }
}

FMFTS_INLINE void look_all(const fmfts_sources *sources, const double *place, fmfts_sight *sight)
{
    look(&sources->source[0], place, &sight[0]);
    for (size_t m = 1; m < FMFTS_MAX_MAGNETS && m < sources->count; m++) {
        look(&sources->source[m], place, &sight[m]);
    }
}

/* Returns the whole prediction along one direction. column: its derivatives. sight: of each magnet from this place. */
FMFTS_INLINE double sense_all(const fmfts_sources *sources, const fmfts_sight *sight, const double *state,
                              const double *place, const double *direction, double *column)
{
    double sum = sense(&sources->source[0], &sight[0], direction, column);
    for (int i = 0; i < 3; i++) {
        column[AMBIENT_COLUMN + i] = direction[i];
    }
    sum += dot3(state + AMBIENT_VALUE, direction);
    if (sources->with_gradient) {
        sum += sense_gradient(state + GRADIENT_VALUE, place, direction, column + GRADIENT_COLUMN);
    }
    for (size_t m = 1; m < FMFTS_MAX_MAGNETS && m < sources->count; m++) {
        sum += sense(&sources->source[m], &sight[m], direction, column + first_column(m));
    }
    return sum;
}

#endif
