"""Shape keys: tells ours from the artist's, and checks a mesh before any are written."""
