"""FMUs that this package did not write: one in C for FMI 2.0, one by CasADi's DaeBuilder for FMI 3.0."""

import os
import shutil
import subprocess
import zipfile
from pathlib import Path

import casadi as ca
import fmpy
import pytest

HEADERS = Path(fmpy.__file__).parent / "c-code"
SOURCE = Path(__file__).parent / "foreign" / "hopper.c"

REALS = (
    ("s", "m", 'causality="output" variability="continuous" initial="exact"', 'start="1"'),
    ("v", "m/s", 'causality="local" variability="continuous" initial="exact"', 'start="0"'),
    ("der(s)", "m/s", 'causality="local" variability="continuous" initial="calculated"', 'derivative="1"'),
    ("der(v)", "m/s2", 'causality="local" variability="continuous" initial="calculated"', 'derivative="2"'),
    ("f", "N", 'causality="input" variability="continuous"', 'start="0"'),
    ("m", "kg", 'causality="parameter" variability="fixed" initial="exact"', 'start="2"'),
    ("k", "N/m", 'causality="parameter" variability="tunable" initial="exact"', 'start="8"'),
    ("d", "N.s/m", 'causality="parameter" variability="tunable" initial="exact"', 'start="0.5"'),
    ("e", "1", 'causality="parameter" variability="fixed" initial="exact"', 'start="0.7"'),
    ("l", "m", 'causality="parameter" variability="fixed" initial="exact"', 'start="0.2"'),
    ("bounces", "1", 'causality="local" variability="discrete" initial="exact"', 'start="0"'),
    ("misbehave", "1", 'causality="parameter" variability="fixed" initial="exact"', 'start="0"'),
)


def hopper_description(guid: str = "{hopper}", identifier: str = "hopper") -> str:
    variables = "\n".join(
        f'<ScalarVariable name="{name}" valueReference="{k}" {kind}><Real unit="{unit}" {more}/></ScalarVariable>'
        for k, (name, unit, kind, more) in enumerate(REALS)
    )
    units = "".join(f'<Unit name="{unit}"/>' for unit in sorted({row[1] for row in REALS}))
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Hopper" guid="{guid}" generationTool="by hand"
  variableNamingConvention="structured" numberOfEventIndicators="1">
<ModelExchange modelIdentifier="{identifier}" providesDirectionalDerivative="true"
  completedIntegratorStepNotNeeded="true"/>
<UnitDefinitions>{units}</UnitDefinitions>
<DefaultExperiment startTime="0" stopTime="3"/>
<ModelVariables>
{variables}
</ModelVariables>
<ModelStructure>
<Outputs><Unknown index="1"/></Outputs>
<Derivatives><Unknown index="3" dependencies="2"/><Unknown index="4" dependencies="1 2 5"/></Derivatives>
<InitialUnknowns><Unknown index="3"/><Unknown index="4"/></InitialUnknowns>
</ModelStructure>
</fmiModelDescription>
"""


def build_hopper(folder: Path) -> Path:
    """Compile and pack the FMU 2.0; the test skips where there is no compiler."""
    compiler = shutil.which(os.environ.get("CC", "gcc"))
    if compiler is None:
        pytest.skip("There is no C compiler to build the FMU with.")
    library = folder / "hopper.so"
    flags = ["-shared", "-fPIC", "-O1", f"-I{HEADERS}", str(SOURCE), "-o", str(library)]
    subprocess.run([compiler, *flags], check=True, capture_output=True)
    path = folder / "hopper.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", hopper_description())
        archive.write(library, f"binaries/{fmpy.platform}/hopper.so")
    return path


def build_lag(folder: Path) -> Path:
    """Export x' = (k u - x) / T, y = x² + x, by CasADi as an FMU 3.0 for model exchange."""
    before = Path.cwd()
    os.chdir(folder)  # DaeBuilder writes into the working directory
    try:
        dae = ca.DaeBuilder("lag")
        x = dae.add("x", {"start": 0.5})
        u = dae.add("u", "input", {"start": 0.0})
        lag, gain = (
            dae.add("T", "parameter", "tunable", {"start": 0.4}),
            dae.add("k", "parameter", "tunable", {"start": 2}),
        )
        dae.eq(dae.der(x), (gain * u - x) / lag)
        y = dae.add("y", "output", {})
        dae.eq(y, x**2 + x)
        files = dae.export_fmu({"no_warning": True})
        options = {"include_dirs": [str(HEADERS)], "compiler_options": {"compiler_flags": ["-O1"]}}
        return folder / dae.pack_fmu(dae.compile_fmu(files, options))
    finally:
        os.chdir(before)
