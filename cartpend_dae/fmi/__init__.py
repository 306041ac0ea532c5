"""Functional Mock-up Units: export, import, checks."""
