"""The mesh of a face: how it is read, where its landmarks lie, and which objects belong to it."""
