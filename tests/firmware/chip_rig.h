// A whole emulated board with chips other than the HMC5983 on its switches, and what their data sheets promise.
#ifndef FMFTS_TEST_CHIP_RIG_H
#define FMFTS_TEST_CHIP_RIG_H

#include "../../firmware/emulated/emulated_lis3mdl.h"
#include "../../firmware/emulated/emulated_mlx90393.h"
#include "../../firmware/emulated/emulated_mmc5603nj.h"
#include "../../firmware/emulated/emulated_mmc5983ma.h"
#include "../../firmware/emulated/emulated_qmc5883l.h"
#include "../../firmware/emulated/emulated_qmc5883p.h"
#include "rig.h"

enum { GAIN_CODES_MAX = 6, SPEEDS_MAX = 4 };

union any_chip {
    struct emulated_magnetometer common;
    struct emulated_mmc5983ma mmc5983ma;
    struct emulated_mmc5603nj mmc5603nj;
    struct emulated_mlx90393 mlx90393;
    struct emulated_lis3mdl lis3mdl;
    struct emulated_qmc5883l qmc5883l;
    struct emulated_qmc5883p qmc5883p;
};

// Written again here, not taken from the driver. Ranges in which every field must be reported.
struct promised {
    void (*init)(union any_chip *chip, uint32_t seed);
    uint8_t identification[3], identification_mask[3];
    int gain_codes;
    double counts_per_gauss[GAIN_CODES_MAX][3];
    double range_gauss[GAIN_CODES_MAX];
    double beyond; // share of the range: here an axis must be marked
    double film_gauss; // up to this norm every field must be told; a stronger one upsets its film. 0: it has no such limit
    struct {
        int frames_hz;
        double conversions_hz; // the slowest rate that gives each frame a new sample; 0: the board paces it
    } speeds[SPEEDS_MAX];
    bool fills_period; // its measurements last as long as its period, and the time of a sample is the middle of that
    int single_max_hz; // a rate that the board accepts with one pad; 0: it takes no trigger
    double raw_at_25, raw_per_kelvin; // resolution of its thermometer; 0: none
    double sensitivity_per_k;            // relative, from that of 25 degrees
};

extern const struct promised qmc5883l, qmc5883p, mmc5983ma, mmc5603nj, mlx90393, lis3mdl;
extern union any_chip others[SAMPLER_PADS_MAX][PAD_SENSORS_MAX];
extern const double chip_field_gauss[PAD_SENSORS_MAX][3];

// Starts a board with four of these on each pad. Sensor i sees chip_field_gauss[i], without noise; clocks are off by up
// to 3 %.
void chip_rig_begin(const struct promised *kind, uint8_t pads);
// Then puts such chips on the first switch's other channels, too, and resets the board as at power-on.
void chip_rig_fill_switch(const struct promised *kind);
// chip_rig_begin of one pad, with this gain code and rate, streaming; its packets are forgotten.
void chip_rig_begin_streaming(const struct promised *kind, uint16_t gain_code, uint16_t rate_hz);
void chip_rig_set_field(int sensor, double x, double y, double z);
void chip_rig_settle(void); // measurements of the chips from now on see the present field

// The newest frame sent since the last call.
struct sample_view chip_rig_newest(void);
void chip_rig_check_counts(const struct promised *kind, const struct sample_view *view, int sensor);
void chip_rig_check_counts_of(const struct promised *kind, const struct sample_view *view, int pad, int sensor);

// A test of each kind: `check` is a function of a `const struct promised *`.
#define TEST_EACH_CHIP(check)                                                                                          \
    TEST(qmc5883l_##check)                                                                                             \
    {                                                                                                                  \
        check(&qmc5883l);                                                                                              \
    }                                                                                                                  \
    TEST(qmc5883p_##check)                                                                                             \
    {                                                                                                                  \
        check(&qmc5883p);                                                                                              \
    }                                                                                                                  \
    TEST(mmc5983ma_##check)                                                                                            \
    {                                                                                                                  \
        check(&mmc5983ma);                                                                                             \
    }                                                                                                                  \
    TEST(mmc5603nj_##check)                                                                                            \
    {                                                                                                                  \
        check(&mmc5603nj);                                                                                             \
    }                                                                                                                  \
    TEST(mlx90393_##check)                                                                                             \
    {                                                                                                                  \
        check(&mlx90393);                                                                                              \
    }                                                                                                                  \
    TEST(lis3mdl_##check)                                                                                              \
    {                                                                                                                  \
        check(&lis3mdl);                                                                                               \
    }

#endif
