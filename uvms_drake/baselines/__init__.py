"""Controllers of the field for pressing on a wall, for comparison; one law a file."""
