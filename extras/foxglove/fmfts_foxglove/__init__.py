"""Shows a running daemon in Foxglove: `fmfts-daemon view --foxglove`. A package of its own."""
