"""Contact models, poses and geometries from fields: `calibrate`, `evaluate` and `pose`; `baseline --learn`."""
