#include "chip_rig.h"

#include <math.h>

#include "harness.h"

union any_chip others[SAMPLER_PADS_MAX][PAD_SENSORS_MAX];

const double chip_field_gauss[PAD_SENSORS_MAX][3] = {
    {0.75, -1.5, 0.3}, {-0.25, 0.5, -1.0}, {1.25, 0.125, 0.75}, {-1.5, -0.75, 1.5},
    {0.5, 1.0, -0.25}, {-1.0, 0.25, 0.5},  {0.125, -0.5, 1.0},  {1.5, 0.75, -0.75},
};
static const double clock_ppm[PAD_SENSORS_MAX] = {-30000, 8000, -12000, 30000, 15000, -20000, 4000, -30000};

static void init_mmc5983ma(union any_chip *chip, uint32_t seed)
{
    emulated_mmc5983ma_init(&chip->mmc5983ma, seed);
    chip->mmc5983ma.memsic.repeatability_gauss = 0; // no noise
}

static void init_mmc5603nj(union any_chip *chip, uint32_t seed)
{
    emulated_mmc5603nj_init(&chip->mmc5603nj, seed);
    chip->mmc5603nj.memsic.repeatability_gauss = 0;
}

static void init_qmc5883p(union any_chip *chip, uint32_t seed)
{
    emulated_qmc5883p_init(&chip->qmc5883p, seed);
    chip->qmc5883p.cleared_by_data = seed % 2; // no source states what clears its DRDY
}

static void init_qmc5883l(union any_chip *chip, uint32_t seed)
{
    emulated_qmc5883l_init(&chip->qmc5883l, seed);
}

const struct promised qmc5883l = {
    .init = init_qmc5883l,
    .identification = {0, 0, 0xFF},
    .identification_mask = {0x3E, 0xFE, 0xFF},
    .gain_codes = 2,
    .counts_per_gauss = {{12000, 12000, 12000}, {3000, 3000, 3000}}, // section 2.2
    .range_gauss = {2.73, 10.92},
    .beyond = 1.01,
    .speeds = {{50, 200}, {101, 200}, {200, 200}, {220, 200}},
    .sensitivity_per_k = -5e-4,
};

// ArduPilot, Adafruit_QMC5883P, reznikmm/qmc5883p: 15000, 3750, 2500 and 1000 counts a gauss; overflow beyond ±30000 counts.
const struct promised qmc5883p = {
    .init = init_qmc5883p,
    .identification = {0x80, 0x2C, 0},
    .identification_mask = {0xFF, 0xFF, 0xFF},
    .gain_codes = 4,
    .counts_per_gauss = {{15000, 15000, 15000}, {3750, 3750, 3750}, {2500, 2500, 2500}, {1000, 1000, 1000}},
    .range_gauss = {2.0, 8.0, 12.0, 30.0},
    .beyond = 1.01,
    .speeds = {{50, 200}, {101, 200}, {200, 200}, {220, 200}},
    .sensitivity_per_k = -5e-4,
};

const struct promised mmc5983ma = {
    .init = init_mmc5983ma,
    .identification = {0x30, 0, 0},
    .identification_mask = {0xFF, 0xFF, 0xFF},
    .gain_codes = 1,
    .counts_per_gauss = {{4096, 4096, -4096}}, // the upper 16 of 18 bits with 16384 counts a gauss; left-handed
    .range_gauss = {7.99},
    .beyond = 1.01,
    .film_gauss = 9, // page 2: a field above 10 G upsets it
    .speeds = {{50, 0}, {101, 0}, {200, 0}, {220, 0}},
    .single_max_hz = 203,
    .sensitivity_per_k = -2e-4,
};

// Linux mmc5633.c, Adafruit_MMC56x3: 16384 counts a gauss of 20 bits, ±30 G. What upsets its film is unverified.
const struct promised mmc5603nj = {
    .init = init_mmc5603nj,
    .identification = {0x10, 0, 0},
    .identification_mask = {0xFF, 0xFF, 0xFF},
    .gain_codes = 1,
    .counts_per_gauss = {{1024, 1024, -1024}},
    .range_gauss = {29.9},
    .beyond = 1.01,
    .film_gauss = 30,
    .speeds = {{50, 0}, {101, 0}, {200, 0}, {220, 0}},
    .single_max_hz = 203,
    .sensitivity_per_k = -2e-4,
};

// Boards of two makers have it at 0x0C and at 0x18; the third pin setting is tested as well.
static void init_mlx90393(union any_chip *chip, uint32_t seed)
{
    static const uint8_t addresses[] = {0x0C, 0x18, 0x0F, 0x0D};
    emulated_mlx90393_init(&chip->mlx90393, addresses[seed % 4], seed);
}

// Of GAIN_SEL 7 down to 2 the microtesla of a count (table 17), four times as many with RES 2; the converter ends at
// 22000 counts.
#define MLX90393_COUNTS(xy, z) {100 / (4 * (xy)), 100 / (4 * (xy)), 100 / (4 * (z))}

const struct promised mlx90393 = {
    .init = init_mlx90393,
    .identification = {0, 0, 0x0C},
    .identification_mask = {0xF0, 0, 0x0F},
    .gain_codes = 6,
    .counts_per_gauss = {MLX90393_COUNTS(0.150, 0.242), MLX90393_COUNTS(0.200, 0.323), MLX90393_COUNTS(0.250, 0.403),
                         MLX90393_COUNTS(0.300, 0.484), MLX90393_COUNTS(0.376, 0.605), MLX90393_COUNTS(0.451, 0.726)},
    .range_gauss = {131.9, 175.9, 219.9, 263.9, 330.8, 396.8},
    .beyond = 1.01,
    .speeds = {{30, 38.6}, {70, 73.4}, {133, 133.7}, {220, 227}},
    .fills_period = true,
    .single_max_hz = 155, // real parts take up to 1.3 times the table's time
    .raw_at_25 = 46244 - 65536, // 16 bits without a sign, on a wire with one
    .raw_per_kelvin = 45.2,
    .sensitivity_per_k = -3e-4,
};

static void init_lis3mdl(union any_chip *chip, uint32_t seed)
{
    emulated_lis3mdl_init(&chip->lis3mdl, seed % 2 ? 0x1C : 0x1E, seed); // pin SA1: one maker's boards, and another's
}

const struct promised lis3mdl = {
    .init = init_lis3mdl,
    .identification = {0x3D, 0, 0},
    .identification_mask = {0xFF, 0xFF, 0xFF},
    .gain_codes = 4,
    .counts_per_gauss = {{6842, 6842, 6842}, {3421, 3421, 3421}, {2281, 2281, 2281}, {1711, 1711, 1711}},
    .range_gauss = {3.99, 7.99, 11.99, 15.99},
    .beyond = 1.01,
    .speeds = {{50, 80}, {81, 155}, {155, 155}, {220, 300}},
    .single_max_hz = 80,
    .raw_per_kelvin = 8,
    .sensitivity_per_k = -3e-4,
};

static void put(const struct promised *kind, int p, int i)
{
    union any_chip *chip = &others[p][i];
    kind->init(chip, (uint32_t)(p * PAD_SENSORS_FOUND + i + 1));
    chip->common.ppm = clock_ppm[i];
    for (int axis = 0; axis < 3; axis++)
        chip->common.field_gauss[axis] = chip_field_gauss[i][axis];
    rig.emulation.switches[p]->chips[i] = &chip->common.part;
}

void chip_rig_begin(const struct promised *kind, uint8_t pads)
{
    rig_begin(pads);
    for (int p = 0; p < pads; p++) {
        for (int i = 0; i < PAD_SENSORS_FOUND; i++)
            put(kind, p, i);
    }
}

void chip_rig_fill_switch(const struct promised *kind)
{
    emulation_fill_switch(&rig.emulation);
    for (int i = PAD_SENSORS_FOUND; i < PAD_SENSORS_MAX; i++)
        put(kind, 0, i);
}

void chip_rig_begin_streaming(const struct promised *kind, uint16_t gain_code, uint16_t rate_hz)
{
    chip_rig_begin(kind, 1);
    rig_run_ms(300);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RANGE, 1, 255, gain_code), RESULT_DONE);
    CHECK_EQUAL(rig_ask(WIRE_REQUEST_RATE, 2, 255, rate_hz), RESULT_DONE);
    rig_run_ms(300);
    rig_forget();
}

void chip_rig_settle(void)
{
    for (int i = 0; i < PAD_SENSORS_FOUND; i++)
        magnetometer_advance(&others[0][i].common.part, rig.emulation.bench.now_ns);
}

void chip_rig_set_field(int sensor, double x, double y, double z)
{
    double *field = others[0][sensor].common.field_gauss;
    chip_rig_settle();
    field[0] = x;
    field[1] = y;
    field[2] = z;
}

struct sample_view chip_rig_newest(void)
{
    struct sample_view view = {.sensor_count = 0};
    for (const uint8_t *packet; (packet = rig_find(WIRE_SAMPLE)) != NULL;)
        view = rig_sample(packet);
    CHECK_EQUAL(view.sensor_count, 4);
    return view;
}

void chip_rig_check_counts(const struct promised *kind, const struct sample_view *view, int sensor)
{
    chip_rig_check_counts_of(kind, view, 0, sensor);
}

void chip_rig_check_counts_of(const struct promised *kind, const struct sample_view *view, int pad, int sensor)
{
    for (int axis = 0; axis < 3; axis++) {
        double due = others[pad][sensor].common.field_gauss[axis] * kind->counts_per_gauss[view->gain_code][axis];
        double tolerance = 1 + 0.002 * fabs(due); // tables of data sheets round to 0.2 %
        CHECK_BETWEEN(view->counts[sensor][axis], due - tolerance, due + tolerance);
    }
}
