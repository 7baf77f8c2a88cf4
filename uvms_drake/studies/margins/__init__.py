"""Tolerances: the largest size of each source of error under which a certificate holds."""
