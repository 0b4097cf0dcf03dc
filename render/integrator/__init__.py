"""The path tracer, its light sampler and its sampler.

Importing its modules imports Mitsuba, so an engine of a compiled variant must have been started.
"""
