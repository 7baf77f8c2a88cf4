"""Benchmarks: step times of the controller, the plant and the simulation."""
