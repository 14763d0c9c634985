"""Training-free ways to spread landmark motion, and learned additions to them."""
