"""Lip-sync tools that packages carry, on the recordings of faces that we are measured on."""
