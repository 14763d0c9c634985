"""The default head: an ICT identity on a triangulation of our own, with eyes, teeth and tongue."""
