#!/bin/sh
# PYTHONPATH is the directory with the package and the modules that the system lacks; the I2C reader's process inherits it.
# A script, because `-m` would also import from the current folder (Python 3.10 has no -P).
PYTHONPATH=@LIB@ exec @PYTHON@ -s @LIB@/bin/fmfts-daemon "$@"
