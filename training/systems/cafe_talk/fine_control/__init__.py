"""Measures how well Cafe-Talk's control works: metrics, and trials of a finished run on held-out clips."""
