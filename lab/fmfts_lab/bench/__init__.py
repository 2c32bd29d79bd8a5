"""What the solver costs and what it is worth, measured: `python -m fmfts_lab.bench speed | accuracy | convergence`."""
