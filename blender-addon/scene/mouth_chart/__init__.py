"""Mouth charts in the scene: drawn mouths that change with what is said."""
