"""Cafe-Talk (Chen et al. 2025): speech to ARKit weights under coarse and fine control."""
