"""The files of a robot's folder: hydrodynamics, thrusters, and the checks of both."""
