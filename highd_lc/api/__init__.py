"""The door for Python: what ``import highd_lc as lc`` offers, one module a subject (docs/api.md)."""
