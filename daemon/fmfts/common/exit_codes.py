"""The exit codes of every verb. One cause has one code, whichever verb meets it; `--help` and the manual print them."""

from __future__ import annotations

DONE = 0
FAULTY = 1
USAGE = 2
DATA = 65  # EX_DATAERR
UNAVAILABLE = 69  # EX_UNAVAILABLE
LACKING = 72  # EX_OSFILE
UNWRITABLE = 73  # EX_CANTCREAT
CONFIG = 78  # EX_CONFIG
INTERRUPTED = 130
READER_GONE = 141

# systemd does not start the service again after these: only a person can mend the cause (systemd/fmfts.service).
LASTING = LACKING, UNWRITABLE, CONFIG

MEANING = {
    DONE: "done",
    FAULTY: "the self-test failed, or probe found a sensor that gives nothing or is not as configured",
    USAGE: "usage: a wrong option, or a pad that is not there",
    DATA: "data, device or daemon refused",
    UNAVAILABLE: "device or daemon absent",
    LACKING: "a Python package is missing, or of another version",
    UNWRITABLE: "a file or folder cannot be written, or the disk is full",
    CONFIG: "bad configuration",
    INTERRUPTED: "interrupted with Ctrl-C",
    READER_GONE: "the reader of a pipe left",
}

# By the name of the error, so that nothing is imported here. An error without a name of its own counts as its base.
OF_ERROR = {
    # a wrong option or name
    "NoSuchPadError": USAGE,
    "OptionError": USAGE,
    "RefusedAddressError": USAGE,
    # the request cannot be carried out with these data, or now
    "BaselineError": DATA,
    "BadRequestError": DATA,
    "CannotError": DATA,
    "DataError": DATA,
    "RecordingError": DATA,
    "RefusedError": DATA,
    # a device or daemon is absent
    "AbsentError": UNAVAILABLE,
    "BusError": UNAVAILABLE,
    "ClusterError": UNAVAILABLE,
    "ControlError": UNAVAILABLE,
    "EndpointError": UNAVAILABLE,
    "FeedError": UNAVAILABLE,
    "NothingCameError": UNAVAILABLE,
    "SchemaError": UNAVAILABLE,
    # a package is missing, or of another version
    "LackingError": LACKING,
    "PackageError": LACKING,
    "PartError": LACKING,
    # a place cannot be written
    "NotWrittenError": UNWRITABLE,
    "OSError": UNWRITABLE,
    "StateError": UNWRITABLE,
    # the configuration cannot be carried out
    "BadKeyError": CONFIG,
    "ConfigError": CONFIG,
    "KeysError": CONFIG,
    "ModelError": CONFIG,
    "RealtimeError": CONFIG,
    "SourceError": CONFIG,
}


def code_of(error: BaseException) -> int:
    """The exit code of this error's cause. A daemon's answer, or another package's error, brings its `code`."""
    told = getattr(error, "code", None)
    if isinstance(told, int):
        return told
    names = (kind.__name__ for kind in type(error).__mro__)
    return next((OF_ERROR[name] for name in names if name in OF_ERROR), DATA)
