"""Effect of actuators on the tube: zero-order hold, lags, dead times, thrusters."""
