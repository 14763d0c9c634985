"""Takes: how they are written, removed, kept beside others, changed, and redone in part."""
