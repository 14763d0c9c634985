"""Noise schedules and samplers, independent of any network. Twin of `rust-core/src/diffusion`."""
