"""The user interface: properties, panels, operators."""
