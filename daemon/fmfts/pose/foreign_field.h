/* A foreign field, of steel or another magnet: unknown, and not uniform over the pad. Its standard deviations. */
#ifndef FMFTS_FOREIGN_FIELD_H
#define FMFTS_FOREIGN_FIELD_H

#define FMFTS_FOREIGN_UNIFORM_T 1e-5
/* The gradient that a magnet 60 mm away or a steel tool makes: 22 mG from the middle of the pad to a sensor. */
#define FMFTS_FOREIGN_GRADIENT_T_PER_M 3e-4

#endif
