"""Shape keys: which are ours and which the artist's, and what must hold before some are written."""
