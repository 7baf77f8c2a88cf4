"""The finite-horizon optimal control problem, and its solution by sequential convex programming."""
