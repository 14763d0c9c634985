"""Lip-sync tools from public packages, measured on the same face recordings as our own motion."""
