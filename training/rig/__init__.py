"""A rig from nothing: the ARKit shapes of any head. Twin of `rust-core/src/rig`."""
