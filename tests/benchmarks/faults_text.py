"""The section of docs/validation.md on faults: what `faults.py` recorded, as Markdown."""

TITLE, END = "## Faults", "\n## "
INTRODUCTION = """`python tests/benchmarks/faults.py --write docs/validation.md`
(as root, for disks of a size; with atheris and Dask)

What was done to a run from outside, how often, and what was lost by it: a result that differs from that of a run that
nothing disturbed, one that could not be had any more, a traceback instead of a sentence, a file left over."""


def section(rows):
    """Return the lines of the section."""
    lines = [TITLE, "", *INTRODUCTION.splitlines(), ""]
    lines += ["| fault | what was done | how often | what came of it | lost |", "|---|---|--:|---|--:|"]
    for row in rows:
        lost = f"**{row['lost']}**" if row["lost"] else "nothing"
        lines.append(f"| {row['fault']} | {row['done']} | {row['times']:,} | {row['found']} | {lost} |")
    return [*lines, ""]


def into(path, rows):
    """Put the section into a page, in place of the one that stands there, or at its end."""
    text = path.read_text("utf-8")
    before, found, rest = text.partition(TITLE)
    after = rest[rest.index(END) + 1 :] if found and END in rest else ""
    path.write_text(before.rstrip("\n") + "\n\n" + "\n".join(section(rows)) + ("\n" + after if after else ""), "utf-8")
