"""An inspection job as a list of steps: what is asked for next, by what was felt; no controller."""
