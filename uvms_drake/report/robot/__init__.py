"""The data sheet of a robot: numbers, views and page."""
