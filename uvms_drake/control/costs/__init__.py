"""Terms of the nominal MPC's cost, one kind a file."""
