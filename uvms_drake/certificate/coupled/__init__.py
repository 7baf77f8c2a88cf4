"""The coupled linear loop of a scenario: its budget, and a run as that loop has it."""
