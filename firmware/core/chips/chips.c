#include "chip.h"

const struct chip_place chip_places[CHIP_PLACES] = {
    {&chip_hmc5983, 0x1E},
    {&chip_qmc5883l, 0x0D},
    {&chip_qmc5883p, 0x2C},
    {&chip_mmc5983ma, 0x30},
    {&chip_mmc5603nj, 0x30}, // the MMC5983MA's, too
    {&chip_lis3mdl, 0x1C},
    {&chip_lis3mdl, 0x1E}, // the HMC5983's, too
    {&chip_mlx90393, 0x0C},
    {&chip_mlx90393, 0x0D}, // the QMC5883L's, too
    {&chip_mlx90393, 0x0E},
    {&chip_mlx90393, 0x0F},
    {&chip_mlx90393, 0x10},
    {&chip_mlx90393, 0x11},
    {&chip_mlx90393, 0x12},
    {&chip_mlx90393, 0x13},
    {&chip_mlx90393, 0x14},
    {&chip_mlx90393, 0x15},
    {&chip_mlx90393, 0x16},
    {&chip_mlx90393, 0x17},
    {&chip_mlx90393, 0x18},
    {&chip_mlx90393, 0x19},
    {&chip_mlx90393, 0x1A},
    {&chip_mlx90393, 0x1B},
};

uint8_t chip_speed_for(const struct chip *chip, uint16_t rate_hz)
{
    uint8_t speed = 0;
    while (speed + 1 < chip->speed_count && chip->speeds[speed].rate_hz < rate_hz)
        speed++;
    return speed;
}

int16_t chip_limited(int count, int largest)
{
    return (int16_t)(count > largest || count < -largest ? CHIP_SATURATED : count);
}
