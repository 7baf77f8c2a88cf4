"""What stands between plant and controller: one part, one file."""
