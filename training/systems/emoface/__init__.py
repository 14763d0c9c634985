"""EmoFace (Lin et al. 2025): what is said and how it is felt, apart."""
