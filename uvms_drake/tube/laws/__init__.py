"""Tubes of the ancillary laws, one a file."""
