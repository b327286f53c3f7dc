"""Equations: arrays in, arrays out, SI units."""
