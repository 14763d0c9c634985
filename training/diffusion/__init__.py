"""Schedules and samplers; knows no network. Twin of `rust-core/src/diffusion`."""
