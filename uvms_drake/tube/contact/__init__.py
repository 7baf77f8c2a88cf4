"""The effect of force-sensor errors on the tube."""
