"""Head and eyes of a take: the objects and bones that it turns."""
