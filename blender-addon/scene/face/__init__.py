"""The mesh of a face: what is read of it, where its landmarks lie, what stands beside it."""
