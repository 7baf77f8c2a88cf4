"""Constants of robot and declared set: proven by branch and bound, or estimated."""
