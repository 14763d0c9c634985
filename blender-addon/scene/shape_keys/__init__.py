"""Shape keys: which are ours and which the artist's, and the checks before any are written."""
