"""Timings of the PyTorch twins, to hold the Rust ones against."""
