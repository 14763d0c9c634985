"""Training of Anyface: the same model files as `rust-core/src`, in PyTorch."""
