"""Errors, YAML and JSON, files, alarms and wiring for every room; it knows nothing of robots."""
