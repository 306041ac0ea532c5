"""FMI: models as FMUs that run in other tools."""

from cartpend_dae.fmi.export import export_fmu

__all__ = ["export_fmu"]
