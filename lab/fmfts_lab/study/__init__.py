"""Commands that chart what was claimed: methods side by side on the same frames, on anybody's machine and pad."""
