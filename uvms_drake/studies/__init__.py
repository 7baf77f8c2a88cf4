"""Studies of a scenario: step times, gains, laws; no run and no certificate depends on them."""
