"""Computes the constants of exp and log in decimals, rounded once, so that they are the same on every processor.

`python tests/unit/exp_tables.py` prints arithmetic/tables.h.
"""

from __future__ import annotations

from decimal import Context, Decimal
from functools import cache

EXP_STEPS = 32
_CONTEXT = Context(prec=60)
_LN2 = _CONTEXT.ln(Decimal(2))
# LN2_HIGH has so few bits that its product with any exponent of a double, in steps of 1/32, is exact.
LN2_HIGH = float(int(_LN2 * 2**37)) / 2**37
LN2_LOW = float(_CONTEXT.subtract(_LN2, Decimal(LN2_HIGH)))


@cache
def _power_of_two(step: int) -> tuple[float, float]:
    """2^(step/32) as a sum of two doubles."""
    value = _CONTEXT.exp(_CONTEXT.multiply(_LN2, _CONTEXT.divide(Decimal(step), Decimal(EXP_STEPS))))
    return float(value), float(_CONTEXT.subtract(value, Decimal(float(value))))


POWERS_OF_TWO = tuple(_power_of_two(step) for step in range(EXP_STEPS))


def header() -> str:
    """The text of tables.h."""
    powers = "\n".join(f"    {{{high.hex()}, {low.hex()}}}," for high, low in POWERS_OF_TWO)
    return f"""\
/* Made by python tests/unit/exp_tables.py > daemon/fmfts/arithmetic/tables.h */
#ifndef FMFTS_TABLES_H
#define FMFTS_TABLES_H

#define FMFTS_EXP_STEPS {EXP_STEPS}
#define FMFTS_LN2_HIGH {LN2_HIGH.hex()}
#define FMFTS_LN2_LOW {LN2_LOW.hex()}

/* 2^(i/{EXP_STEPS}) as a sum of two doubles */
static const double FMFTS_POWERS_OF_TWO[FMFTS_EXP_STEPS][2] = {{
{powers}
}};

#endif
"""


if __name__ == "__main__":
    print(header(), end="")
