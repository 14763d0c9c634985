"""Words about faces: a small text space made from WordNet, and what turns a sentence into action units."""
