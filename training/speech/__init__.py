"""Speech front end and encoders. Twin of `rust-core/src/speech`."""
