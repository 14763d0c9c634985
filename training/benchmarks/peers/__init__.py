"""Lip-sync tools from public packages, measured on the face recordings that we measure ourselves on."""
