"""Exit codes of the commands, as sysexits.h has them."""

USAGE = 2
DATA = 65  # EX_DATAERR
UNAVAILABLE = 69  # EX_UNAVAILABLE
CONFIG = 78  # EX_CONFIG: systemd does not restart after it
