"""The picture of a run in Meshcat, live and recorded; it knows the model, but no scenario."""
