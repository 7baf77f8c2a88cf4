"""Nominal MPC as a system: planning at sampling instants, solver faults, infeasibility."""
