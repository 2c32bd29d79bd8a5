/* The tables of pose/ and contact/ together, and the numbers of a message. */
#ifndef FMFTS_FRAME_TABLES_H
#define FMFTS_FRAME_TABLES_H

#include "../../contact/now.h"
#include "../../pose/motion.h"

/* What contact_message.py needs of a pad. */
#define FMFTS_MESSAGE_PARAMETERS(X)                                                                                    \
    X(has_model, 1)             /* 0: no contact model, so that places and forces are not known */                     \
    X(detection_limit_n, 1)                                                                                            \
    X(rest_variance, 6)                                                                                                \
    X(remanence_t, 1)                                                                                                  \
    X(ambient_t, 3)             /* NaN: not measured */                                                                \
    X(ambient_variance, 3)

FMFTS_STRUCT(fmfts_message_parameters, FMFTS_MESSAGE_PARAMETERS)

#define FMFTS_PARAMETERS(X) \
    FMFTS_POSE_PARAMETERS(X) FMFTS_CONTACT_PARAMETERS(X) FMFTS_MOTION_PARAMETERS(X) FMFTS_NOW_PARAMETERS(X)                \
    FMFTS_MESSAGE_PARAMETERS(X)
typedef struct {
    fmfts_pose_parameters pose;
    fmfts_contact_parameters contact;
    fmfts_motion_parameters motion;
    fmfts_now_parameters now;
    fmfts_message_parameters message;
} fmfts_parameters;

#define FMFTS_MEMORY(X) FMFTS_POSE_MEMORY(X) FMFTS_CONTACT_MEMORY(X) FMFTS_MOTION_MEMORY(X) FMFTS_NOW_MEMORY(X)
typedef struct {
    fmfts_pose_memory pose;
    fmfts_contact_memory contact;
    fmfts_motion_memory motion;
    fmfts_now_memory now;
} fmfts_memory;

/* The numbers of a message, by the names of its fields; now_: of its map `now`. */
#define FMFTS_NUMBERS(X)                                                                                               \
    X(temperature_c, 1)                                                                                                \
    X(x_m, 1)                                                                                                          \
    X(x_sd_m, 1)                                                                                                       \
    X(y_m, 1)                                                                                                          \
    X(y_sd_m, 1)                                                                                                       \
    X(force_n, 1)                                                                                                      \
    X(force_sd_n, 1)                                                                                                   \
    X(force_min_n, 1)                                                                                                  \
    X(shear_x_n, 1)                                                                                                    \
    X(shear_x_sd_n, 1)                                                                                                 \
    X(shear_y_n, 1)                                                                                                    \
    X(shear_y_sd_n, 1)                                                                                                 \
    X(displacement_m, 1)                                                                                               \
    X(displacement_sd_m, 1)                                                                                            \
    X(position_m, 3)                                                                                                   \
    X(position_sd_m, 3)                                                                                                \
    X(axis, 3)                                                                                                         \
    X(axis_sd_rad, 1)                                                                                                  \
    X(remanence_t, 1)                                                                                                  \
    X(remanence_sd_t, 1)                                                                                               \
    X(ambient_t, 3)                                                                                                    \
    X(ambient_sd_t, 3)                                                                                                 \
    X(residual_t, 1)                                                                                                   \
    X(chi2, 1)                                                                                                         \
    X(now_x_m, 1)                                                                                                      \
    X(now_x_sd_m, 1)                                                                                                   \
    X(now_x_rate_m_per_s, 1)                                                                                           \
    X(now_x_rate_sd_m_per_s, 1)                                                                                        \
    X(now_y_m, 1)                                                                                                      \
    X(now_y_sd_m, 1)                                                                                                   \
    X(now_y_rate_m_per_s, 1)                                                                                           \
    X(now_y_rate_sd_m_per_s, 1)                                                                                        \
    X(now_force_n, 1)                                                                                                  \
    X(now_force_sd_n, 1)                                                                                               \
    X(now_force_rate_n_per_s, 1)                                                                                       \
    X(now_force_rate_sd_n_per_s, 1)                                                                                    \
    X(now_shear_x_n, 1)                                                                                                \
    X(now_shear_x_sd_n, 1)                                                                                             \
    X(now_shear_x_rate_n_per_s, 1)                                                                                     \
    X(now_shear_x_rate_sd_n_per_s, 1)                                                                                  \
    X(now_shear_y_n, 1)                                                                                                \
    X(now_shear_y_sd_n, 1)                                                                                             \
    X(now_shear_y_rate_n_per_s, 1)                                                                                     \
    X(now_shear_y_rate_sd_n_per_s, 1)

FMFTS_STRUCT(fmfts_numbers, FMFTS_NUMBERS)

/* Kind of path.py. FMFTS_NO_NUMBER: the frame is not healthy. */
typedef enum { FMFTS_QUIET, FMFTS_TOUCHED, FMFTS_OVER_RANGE, FMFTS_NO_NUMBER } fmfts_kind;

/* message.c: writes into `text` [size]. place: the offsets of the integers, then of every number; −1: not in the text. */
enum { FMFTS_MESSAGE_INTEGERS = 5, FMFTS_NUMBER_COUNT = sizeof(fmfts_numbers) / sizeof(double) };
void fmfts_write_numbers(uint8_t *text, size_t size, const int32_t *place, const unsigned long long *integer,
                const fmfts_numbers *numbers);

#endif
