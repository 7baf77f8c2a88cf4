"""Finite-horizon optimal control problems, and their solution by sequential convex programming."""
