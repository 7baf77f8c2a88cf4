"""The effect of actuators on the tube: held commands, lags, dead times, thrusters."""
