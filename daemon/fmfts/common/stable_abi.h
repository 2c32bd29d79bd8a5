/* One build serves every Python from 3.11 on. Python 3.10's stable ABI has no buffers, so that a build for it serves it alone. */
#ifndef FMFTS_STABLE_ABI_H
#define FMFTS_STABLE_ABI_H

#include <patchlevel.h>
#if PY_VERSION_HEX >= 0x030B0000
#define Py_LIMITED_API 0x030B0000
#endif

#endif
