"""The file that `fmfts-daemon report` writes: a recording, and beside it the facts of the computer and its chips."""
