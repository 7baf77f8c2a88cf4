"""What stands between controller and plant: one part, one file."""
