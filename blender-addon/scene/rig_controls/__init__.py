"""Controls of a rig: which there are, what they move, and the actions that play them."""
