"""The path tracer, its light sampler and its sampler."""
