"""Text about faces: a small text space made from WordNet, and a tower from sentences to action units."""
