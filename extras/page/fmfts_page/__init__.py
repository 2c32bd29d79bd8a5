"""The page in a browser: a subscriber like any other, in a process of its own, so that no browser delays the daemon."""
