"""Blender's curves: actions, keyframes, and the values of panel settings over time."""
