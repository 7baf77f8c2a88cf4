"""Solver cascade of the convex program of one sequential convex iteration."""
