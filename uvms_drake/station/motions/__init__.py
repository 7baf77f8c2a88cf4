"""The kinds of motion that a scenario can name, one a file."""
