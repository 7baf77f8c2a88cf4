"""Parts between controller and plant, one a file; they know neither the one nor the other."""
