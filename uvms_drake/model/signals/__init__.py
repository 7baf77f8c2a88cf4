"""Signals of the loop: the interface of sensors and actuators, sampled vectors."""
