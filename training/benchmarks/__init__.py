"""Timings of the PyTorch twins, to compare with the Rust ones, and our motion compared with other tools."""
