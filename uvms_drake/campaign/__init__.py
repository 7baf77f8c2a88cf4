"""Many drawn runs of one scenario, and what they came to; it knows no command line."""
