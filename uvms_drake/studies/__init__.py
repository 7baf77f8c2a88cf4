"""What else one may ask: how fast, which gains, which law."""
