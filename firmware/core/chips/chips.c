#include "chip.h"

const struct chip *const chip_kinds[CHIP_KINDS] = {&chip_hmc5983, &chip_qmc5883l};
