"""The controller in a loop of one's own: at its clock, with its sensors, in real time."""
