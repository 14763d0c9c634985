"""Takes: written, removed, kept beside others, changed, and made again in part."""
