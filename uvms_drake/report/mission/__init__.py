"""Summary and figures of an inspection mission."""
