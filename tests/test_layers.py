"""The sources as text: imports go one way, stand at the top, and no file is too long to read in one sitting."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import cartpend_dae

PACKAGE = Path(__file__).resolve().parent.parent / "cartpend_dae"
ROOT = PACKAGE.name
MAX_LINES = 400

LAYERS = """
    errors units graph explicit everyday notebook latex
    parcel
    parallel
    cluster
    explain linear compiled calls along
    quantities collector
    declarations switching
    language
    splice
    library
    shelf
    hybrid
    system
    prepared
    gathered dimension_rules statements
    templates connections dimensions
    happenings
    freeze balance timekeeping
    flatten
    rows diagnose
    singular contradiction
    chains hidden
    alias
    selection
    index
    tear
    sort merge continuous
    assemble structure
    dae
    memory
    events
    start_conditions start_solver trouble
    start_paths
    start_search
    start_failure
    initialize
    start_report
    study_paths
    study_schema
    columns
    text_tables matlab_tables
    tables
    data
    recording
    pieces figures
    study
    linear_model stepping inputs integration
    operating_point breakdown
    linearize design
    hybrid_problem time_events
    begin
    plugins
    native
    integrate
    simulate start_slopes coincidence
    sensitivity
    unknowns
    transcribe
    strides passes
    starts cuts
    programme
    problem
    shooting
    directions residual_noise gauss_newton piece_scatter collocation_programme
    collocation
    uncertainty weak
    identify
    exact_form
    starting likelihood bootstrap bands excitation
    experiment_design
    assess horizons
    effects
    discover
    multistart
    session
    fmi
    data_report planning
    report.text
    plots animate
    fmi modelica
    plot
    report
    fleet
    progress
    console
    project
    commands
    cli
    __main__
"""
"""Each line may import from the lines above it; modules on one line do not know each other.

A folder is one layer, but for the files of it that have a line of their own.
"""

HEAVY = {"cloudpickle", "distributed", "fmpy", "h5py", "jinja2", "matplotlib", "pandas", "pyarrow", "pymoca", "xarray"}
"""Optional or slow to import: only these may be imported inside a function."""

LAYER_OF = {module: level for level, line in enumerate(LAYERS.split("\n")) for module in line.split()}
FILES = sorted(PACKAGE.rglob("*.py"))


@dataclass(frozen=True)
class Import:
    line: int
    target: str
    inside_function: bool

    @property
    def module(self) -> str:
        """The layer of this package that is imported; empty for the package itself."""
        return layer_of(self.target.partition(".")[2])


def layer_of(dotted: str) -> str:
    return dotted if dotted in LAYER_OF else dotted.split(".")[0]


def label(file: Path) -> str:
    return str(file.relative_to(PACKAGE))


def own_layer(file: Path) -> str:
    return layer_of(".".join(file.relative_to(PACKAGE).with_suffix("").parts))


def imports_of(file: Path) -> list[Import]:
    def walk(node: ast.AST, inside: bool) -> Iterator[Import]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import):
                yield from (Import(child.lineno, alias.name, inside) for alias in child.names)
            elif isinstance(child, ast.ImportFrom):
                module = child.module or ""
                names = [alias.name for alias in child.names] if module == ROOT else [""]
                yield from (
                    Import(child.lineno, f"{module}.{name}".rstrip("."), inside)
                    if not child.level
                    else Import(child.lineno, f"{ROOT}.{own_layer(file)}", inside)
                    for name in names
                )
            elif not (isinstance(child, ast.If) and ast.unparse(child.test).endswith("TYPE_CHECKING")):
                yield from walk(child, inside or isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef))

    return list(walk(ast.parse(file.read_text(encoding="utf-8")), False))


def place(file: Path, found: Import) -> str:
    return f"{file.relative_to(PACKAGE.parent)}:{found.line} imports {found.target}"


@pytest.mark.parametrize("file", FILES, ids=label)
def test_imports_go_one_way(file):
    layer = own_layer(file)
    if layer in ("__init__", "demo"):
        return  # the public names may import everything, and only a user's model may import them
    assert layer in LAYER_OF, f"`{layer}` has no place in LAYERS: say what it may import"
    # the public names stand as high as the highest module that offers one
    public = max(LAYER_OF[layer_of(module)] for module in cartpend_dae._HOMES.values())
    wrong = [
        place(file, found)
        for found in imports_of(file)
        if found.target.split(".")[0] == ROOT
        and found.module != layer
        and LAYER_OF.get(found.module, public) >= LAYER_OF[layer]
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("file", FILES, ids=label)
def test_imports_stand_at_the_top(file):
    wrong = [
        place(file, found)
        for found in imports_of(file)
        if found.inside_function and found.target.split(".")[0] not in HEAVY
    ]
    assert not wrong, "\n".join(wrong)


def test_no_file_is_too_long_to_read():
    lengths = {str(file.relative_to(PACKAGE)): len(file.read_text(encoding="utf-8").splitlines()) for file in FILES}
    assert {name: n for name, n in lengths.items() if n > MAX_LINES} == {}


def test_files_inside_a_folder_do_not_import_in_a_circle():
    """Folders are one layer, but inside them too a reader must be able to start somewhere."""
    graph: dict[str, set[str]] = {}
    for file in FILES:
        parts = file.relative_to(PACKAGE).with_suffix("").parts
        if len(parts) > 1 and parts[-1] != "__init__":
            targets = {found.target.removeprefix(f"{ROOT}.") for found in imports_of(file)}
            graph[".".join(parts)] = targets - {parts[0]}
    left = set(graph)
    while free := {name for name in left if not graph[name] & left}:
        left -= free
    assert not left, f"imported in a circle: {sorted(left)}"


RUNS_CODE = {"eval", "exec", "compile", "__import__"}
UNPICKLES = {"pickle", "cPickle", "marshal", "shelve", "dill", "joblib", "cloudpickle"}


def test_data_are_never_unpickled_or_evaluated():
    """A model file is code and is run as such; parcels between processes of one's own are unpickled; nothing else."""
    found = []
    for file in FILES:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                name = ast.unparse(node.func)
                if name in RUNS_CODE and label(file) != "study.py":
                    found.append(f"{label(file)}:{node.lineno} {name}")
                if name.endswith(("np.load", "numpy.load")):
                    refused = {k.arg: ast.unparse(k.value) for k in node.keywords}.get("allow_pickle") == "False"
                    found += [] if refused else [f"{label(file)}:{node.lineno} {name}"]
                if name.endswith("read_pickle"):
                    found.append(f"{label(file)}:{node.lineno} {name}")
        found += [
            f"{label(file)} imports {one.target}"
            for one in imports_of(file)
            if one.target.split(".")[0] in UNPICKLES and label(file) != "parcel.py"
        ]
    assert not found, "\n".join(found)
