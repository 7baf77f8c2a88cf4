"""What is pressed: one surface, one file."""
