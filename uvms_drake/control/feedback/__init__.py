"""The ancillary feedback as systems: law, observer, feedforward preview, tube monitor."""
