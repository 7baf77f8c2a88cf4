"""Parts between plant and controller, one a file; they know neither the one nor the other."""
