"""Checkers of FMUs that others wrote: FMPy always, the FMU manipulation toolbox where it is installed."""

import importlib
import importlib.util
import logging
from typing import Any

TOOLBOX = "fmu_manipulation_toolbox"


def findings_of_fmpy(path: str) -> list[str]:
    """Return what FMPy finds wrong with an FMU."""
    from fmpy.validation import validate_fmu

    return [" ".join(str(problem).split()) for problem in validate_fmu(path)]


def findings_of_others(path: str) -> dict[str, list[str]]:
    """Return what other installed checkers find wrong with an FMU, by checker."""
    if importlib.util.find_spec(TOOLBOX) is None:
        return {}
    return {"FMU manipulation toolbox": _toolbox(path)}


def _toolbox(path: str) -> list[str]:
    """Run the toolbox's checks; they report by logging."""
    notes: list[str] = []

    class Notes(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.levelno >= logging.ERROR:
                notes.append(" ".join(record.getMessage().split()))

    operations: Any = importlib.import_module(f"{TOOLBOX}.operations")
    checker: Any = importlib.import_module(f"{TOOLBOX}.checker")
    logger, handler = logging.getLogger(TOOLBOX), Notes()
    logger.addHandler(handler)
    try:
        fmu = operations.FMU(path)
        for check in checker.get_checkers():
            fmu.apply_operation(check())
    except Exception as error:  # a checker of others may raise anything
        notes.append(f"it fails with {type(error).__name__}: {' '.join(str(error).split())[:300]}")
    finally:
        logger.removeHandler(handler)
    return notes
