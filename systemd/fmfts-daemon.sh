#!/bin/sh
# PYTHONPATH is the directory with the package and the modules that the system lacks; the I2C reader's process inherits it.
PYTHONPATH=@LIB@ exec @PYTHON@ -sP -m fmfts "$@"
