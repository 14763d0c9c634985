"""Controls of a rig: which ones there are, what they move, and the actions that play them."""
