"""Figures and pages from tables."""
