"""What a run leaves behind for people: summary, figures, report, replay."""
