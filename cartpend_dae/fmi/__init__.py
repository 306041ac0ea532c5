"""Functional Mock-up Units: models as FMUs that run in other tools, and foreign ones read, checked and simulated."""

from cartpend_dae.fmi.export import export_fmu

__all__ = ["export_fmu"]
