"""Point caches on disk."""
