"""Exit codes of the commands, from sysexits.h."""

USAGE = 2
DATA = 65  # EX_DATAERR
UNAVAILABLE = 69  # EX_UNAVAILABLE
CONFIG = 78  # EX_CONFIG: systemd does not restart the service after it
