#!/bin/sh
# The directory of its own holds the package and what the system's Python lacks; the I2C reader inherits the path.
PYTHONPATH=@LIB@ exec @PYTHON@ -sP -m fmfts "$@"
