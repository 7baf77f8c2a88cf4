"""A first scenario for a robot, as a file or as objects; no run and no certificate needs it."""
