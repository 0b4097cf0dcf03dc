"""Benchmarks of the resampler, flows, pictures and the production, against the machine and other programs."""
