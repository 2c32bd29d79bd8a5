"""What the solver costs and what it is worth, measured: `python -m fmfts.bench speed | accuracy | convergence`."""
