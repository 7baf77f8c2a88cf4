"""The scenario: its schema, its files, its checks."""
