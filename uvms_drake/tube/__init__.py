"""The theory: constants, tubes, terminal sets; it knows no scenario."""
