"""Errors, YAML and JSON, output files and alarms for every room; it knows nothing of robots."""
