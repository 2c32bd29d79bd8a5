"""The laboratory: benchmarks, studies and finite elements. An installation of its own, which no robot needs."""
