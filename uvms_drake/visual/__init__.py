"""What a person sees of a run in Meshcat, live and recorded."""
