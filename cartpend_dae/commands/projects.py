"""The commands that begin and compare work: a new project, what there is to build from, two results."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from cartpend_dae.console import console_of_results, say, spoken
from cartpend_dae.effects import catalogue
from cartpend_dae.effects.card import Card
from cartpend_dae.errors import ModelError
from cartpend_dae.explain import nearest
from cartpend_dae.project import make_project
from cartpend_dae.report.comparison import Difference, differences, read_result
from cartpend_dae.shelf import Entry, component, components, matching

Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
Words = Annotated[list[str] | None, typer.Argument(metavar="WORDS", help="Only what holds these words.")]


@spoken
def new(folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="A folder that is new or empty.")]) -> None:
    """Start a project that runs: a model, a study and three logs, to be replaced by your own."""
    study = make_project(folder)
    say(
        console_of_results(),
        f"Written: {', '.join(sorted(path.name for path in folder.iterdir()))} in {folder}",
        f"Next: cartpend discover {study}",
    )


def _wanted(words: list[str] | None) -> str:
    """Join the words of a search; `list` in front says only what the command does anyway."""
    return " ".join(words[1:] if words and words[0] == "list" else words or ())


@spoken
def list_components(words: Words = None, as_json: Json = False) -> None:
    """List the components of the library; of one named exactly, say all."""
    entries, text = components(), _wanted(words)
    exact = [entry for entry in entries if text in (entry.name, entry.name.split(".")[1])]
    if len(exact) == 1:
        _tell(exact[0], as_json)
        return
    found = exact or matching(entries, text)
    if not found:
        component(text)  # says what is near
    if as_json:
        print(json.dumps([asdict(entry) for entry in found], indent=1))
        return
    table = _table("component", "what it is")
    for entry in found:
        table.add_row(entry.name, entry.summary)
    console_of_results().print(table)
    count = f"{len(found)} component{'s' * (len(found) != 1)}"
    say(console_of_results(), f"{count}; `cartpend components NAME` says all of one.")


@spoken
def list_effects(words: Words = None, as_json: Json = False) -> None:
    """List the effects that `discover` tries; of one named exactly, say all."""
    cards, text = catalogue(), _wanted(words)
    found = [card for card in cards if all(w in f"{card.id} {card.summary}".lower() for w in text.lower().split())]
    exact = [card for card in cards if card.id == text]
    if not found:
        near = nearest(text, [card.id for card in cards], otherwise="`cartpend effects` lists all.")
        raise ModelError(f"The catalogue has no effect `{text}`{near}")
    if as_json:
        print(json.dumps([_plain(card) for card in exact or found], indent=1))
        return
    if exact:
        _tell_effect(exact[0])
        return
    table = _table("effect", "goes", "what it is")
    for card in sorted(found, key=lambda card: card.id):
        table.add_row(card.id, card.insertion, card.summary)
    console_of_results().print(table)
    say(console_of_results(), f"{len(found)} effect{'s' * (len(found) != 1)}; `cartpend effects ID` says all of one.")


@spoken
def diff(
    first: Annotated[Path, typer.Argument(metavar="FIRST", help="A folder of results.")],
    second: Annotated[Path, typer.Argument(metavar="SECOND", help="Another one.")],
    as_json: Json = False,
) -> None:
    """Say what two results tell differently: verdict, effects, parameters, errors. Exit code 1 if anything."""
    found = differences(read_result(first), read_result(second))
    if as_json:
        print(json.dumps([asdict(difference) for difference in found], indent=1))
    elif found:
        table = _table("", "name", "first", "second", "unit", "apart")
        for difference in found:
            table.add_row(*_cells(difference))
        console_of_results().print(table)
    else:
        say(console_of_results(), "Both results tell the same.")
    if found:
        raise typer.Exit(1)


def _cells(d: Difference) -> tuple[str, ...]:
    apart = "" if d.distance is None else f"{d.distance:.2g} sd"
    return d.what, d.name, *(_text(value) for value in (d.first, d.second)), d.unit, apart


def _text(value: float | str | None) -> str:
    return "–" if value is None else value if isinstance(value, str) else f"{value:.6g}"


def _table(*headers: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, collapse_padding=True)
    for header in headers:
        table.add_column(header, overflow="fold")
    return table


def _tell(entry: Entry, as_json: bool) -> None:
    if as_json:
        print(json.dumps(asdict(entry), indent=1))
        return
    console = console_of_results()
    say(console, entry.name, "", entry.law, "")
    module, name = entry.name.split(".")
    table = _table("", "name", "unit or kind", "default", "")
    for port, kind in entry.ports.items():
        table.add_row("port", port, kind, "", "")
    for key, signal in entry.signals.items():
        table.add_row(f"signal {signal['direction']}", key, signal["unit"], "", signal["doc"])
    for key, q in entry.parameters.items():
        default = "" if q["default"] is None else f"{q['default']:g}"
        table.add_row("parameter", key, str(q["unit"]), default, str(q["doc"] or ""))
    console.print(table)
    say(console, f"from cartpend_dae.library.{module} import {name}")


def _plain(card: Card) -> dict[str, object]:
    return {
        "id": card.id,
        "summary": card.summary,
        "insertion": card.insertion,
        "dissipative": card.dissipative,
        "nested_in": list(card.nested_in),
        "equivalent_to": dict(card.equivalent_to),
        "excited_by": card.excited_by,
        "source": card.source,
    }


def _tell_effect(card: Card) -> None:
    facts = {
        "goes": card.insertion,
        "only takes energy": "yes" if card.dissipative else "no",
        "contained in": ", ".join(card.nested_in) or "none",
        "alike": "; ".join(f"{name} ({why})" for name, why in card.equivalent_to.items()) or "none",
        "shown by": card.excited_by,
        "source": card.source,
    }
    table = _table("", "")
    table.show_header = False
    for name, value in facts.items():
        table.add_row(name, str(value))
    console = console_of_results()
    say(console, f"{card.id}: {card.summary}", "")
    console.print(table)
