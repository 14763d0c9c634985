"""EmoFace (Lin et al. 2025): separate branches for what somebody says and how he feels."""
