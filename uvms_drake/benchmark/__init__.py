"""Benchmark of controllers that press on a wall: the same cases and draws for all."""
