"""FreeTalk (Nocentini et al. 2026, arXiv:2603.15512)."""
