"""What Cafe-Talk's control is worth: its metrics, and trials of a finished run on held-out clips."""
