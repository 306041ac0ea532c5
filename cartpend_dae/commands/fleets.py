"""The command about many studies."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from cartpend_dae.cluster import workers
from cartpend_dae.commands.studies import ClusterAt, Jobs
from cartpend_dae.console import complain, console_of_results, say, spoken
from cartpend_dae.fleet import Order, run_fleet
from cartpend_dae.report.files import check_folder
from cartpend_dae.report.register import FLEET, Row


class Work(StrEnum):
    """What is done with each study."""

    discover = "discover"
    identify = "identify"


@spoken
def fleet(
    studies: Annotated[list[Path], typer.Argument(metavar="STUDY", help="Study files (TOML).")],
    out: Annotated[Path, typer.Option(help="Folder for the results, with one in it for each study.")] = Path("fleet"),
    command: Annotated[Work, typer.Option(help="What is done with each study.")] = Work.discover,
    jobs: Jobs = 1,
    cluster: ClusterAt = None,
    resume: Annotated[bool, typer.Option("--resume", help="Leave out what was done, go on in what was begun.")] = False,
    placebo: Annotated[int, typer.Option(min=0, metavar="N", help="Repeat on N data sets that lack nothing.")] = 0,
    power: Annotated[int, typer.Option(min=0, metavar="N", help="Repeat on N data sets without each effect.")] = 0,
) -> None:
    """Carry out many studies, each into a folder of its own; a bad one does not stop the others, but exits with 1."""
    check_folder(out)
    order = Order(command.value, placebo, power)
    heard: list[Row] = []

    def told(row: Row) -> None:
        heard.append(row)
        complain(f"{len(heard)} of {len(studies)}: {row.folder}: {_outcome(row)}")

    with workers(jobs, cluster) as place:
        rows = run_fleet(studies, out, order, jobs=place, resume=resume, told=told)
    failed = [row for row in rows if row.state == "failed"]
    console = console_of_results()
    console.print(_table(rows))
    count = f"{len(rows) - len(failed)} of {len(rows)} studies have a result"
    say(console, *(f"{row.folder}: {row.message}" for row in failed), f"{count}.", f"Written: {out / FLEET}")
    if failed:
        raise typer.Exit(1)


def _outcome(row: Row) -> str:
    named = f" ({', '.join(row.effects)})" if row.effects else ""
    kept = ", as before" if row.state == "kept" else ""
    return row.message if row.state == "failed" else f"{row.verdict}{named}{kept}"


def _table(rows: tuple[Row, ...]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, collapse_padding=True)
    for header in ("study", "state", "verdict", "added"):
        table.add_column(header, overflow="fold")
    for header in ("nrmse before", "after", "seconds"):
        table.add_column(header, justify="right")
    for row in rows:
        numbers = ("" if value is None else f"{value:.3g}" for value in (row.before, row.after))
        table.add_row(row.folder, row.state, row.verdict, ", ".join(row.effects), *numbers, f"{row.seconds:.1f}")
    return table
