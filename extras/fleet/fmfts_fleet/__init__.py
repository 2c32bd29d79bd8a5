"""One page for several robots: `fmfts-daemon view --robot NAME=ENDPOINT …`. A package of its own."""
