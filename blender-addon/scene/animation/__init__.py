"""Blender's curves: actions, keyframes, and values of the panel over time."""
