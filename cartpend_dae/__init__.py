"""Acausal modelling of electromechanical systems, calibrated on and corrected by measured data.

The names below are imported when they are first used, so that the command line answers at once.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cartpend_dae.assemble import assemble
    from cartpend_dae.data import Trajectory
    from cartpend_dae.design import Gains, lqr, place
    from cartpend_dae.effects import catalogue, insert, places
    from cartpend_dae.errors import CartpendError, ModelError, SolverError, StructureError, StudyError
    from cartpend_dae.fmi import export_fmu
    from cartpend_dae.language import (
        Component,
        Param,
        Port,
        Statements,
        clock_rate,
        connect,
        der,
        discrete,
        dry_friction,
        flow,
        initial,
        param,
        port,
        signal,
        time,
        unknown,
        var,
    )
    from cartpend_dae.linear_model import LinearModel
    from cartpend_dae.linearize import linearize
    from cartpend_dae.simulate import simulate
    from cartpend_dae.start_report import describe_start
    from cartpend_dae.structure import structure_report
    from cartpend_dae.switching import (
        assign,
        both,
        either,
        if_else,
        noevent,
        pre,
        reinit,
        sample,
        terminate,
        when,
    )
    from cartpend_dae.system import System

__all__ = [
    "CartpendError",
    "Component",
    "Gains",
    "LinearModel",
    "ModelError",
    "Param",
    "Port",
    "SolverError",
    "Statements",
    "StructureError",
    "StudyError",
    "System",
    "Trajectory",
    "assemble",
    "assign",
    "both",
    "catalogue",
    "clock_rate",
    "connect",
    "der",
    "describe_start",
    "discrete",
    "dry_friction",
    "either",
    "export_fmu",
    "flow",
    "if_else",
    "initial",
    "insert",
    "linearize",
    "lqr",
    "noevent",
    "param",
    "place",
    "places",
    "port",
    "pre",
    "reinit",
    "sample",
    "signal",
    "simulate",
    "structure_report",
    "terminate",
    "time",
    "unknown",
    "var",
    "when",
]

_MODULES = {
    "assemble": "assemble",
    "data": "Trajectory",
    "design": "Gains lqr place",
    "effects": "catalogue insert places",
    "errors": "CartpendError ModelError SolverError StructureError StudyError",
    "fmi": "export_fmu",
    "language": "Component Param Port Statements clock_rate connect der discrete dry_friction flow initial param port "
    "signal time unknown var",
    "linear_model": "LinearModel",
    "linearize": "linearize",
    "simulate": "simulate",
    "start_report": "describe_start",
    "structure": "structure_report",
    "switching": "assign both either if_else noevent pre reinit sample terminate when",
    "system": "System",
}
_HOMES = {name: module for module, names in _MODULES.items() for name in names.split()}


class _Package(ModuleType):
    """The package as a module whose public names are looked up when they are needed."""

    def __getattr__(self, name: str) -> object:
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
        super().__setattr__(name, value)
        return value

    def __setattr__(self, name: str, value: object) -> None:
        # a module that is imported becomes an attribute of the package: a function of its name goes first
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*self.__dict__, *__all__})


sys.modules[__name__].__class__ = _Package
