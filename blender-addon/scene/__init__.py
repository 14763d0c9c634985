"""Blender's data without any interface: read mesh and sound, write keys, remove them."""
