"""EmoFace (Lin et al. 2025): separate branches for the content of speech and for its emotion."""
