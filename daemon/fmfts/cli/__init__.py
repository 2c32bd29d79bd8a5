"""The command `fmfts-daemon`: a file for each verb or group of verbs."""
