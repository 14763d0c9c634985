"""Shared layers, the twins of `rust-core/src/nn`."""
