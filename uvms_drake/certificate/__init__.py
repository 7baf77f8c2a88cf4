"""The certificate of a scenario, as data, file and table; it knows no run."""
