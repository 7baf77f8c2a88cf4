"""Supervisor: notices that a run has left its declared class, and takes the robot off the wall."""
