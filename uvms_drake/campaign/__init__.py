"""Monte Carlo campaigns: many drawn runs of one scenario and their statistics."""
