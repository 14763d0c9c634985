"""One folder per paper. Twin of `rust-core/src/systems`."""
