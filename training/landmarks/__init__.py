"""The 68 landmarks of a face mesh: canonical frame, rendering, the network that finds them."""
