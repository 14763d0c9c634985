"""What the artist sees: properties, panel, operators."""
