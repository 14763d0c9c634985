"""Training-free ways to spread landmark motion, and what the learned ones add to them."""
