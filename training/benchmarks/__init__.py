"""Timings of the PyTorch twins, to hold the Rust ones against, and our motion beside that of other tools."""
