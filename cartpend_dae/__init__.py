"""Acausal modelling of electromechanical systems, calibrated on and corrected by measured data."""

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
