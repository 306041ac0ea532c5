"""The section of docs/validation.md on intervals: what `coverage.py` recorded, as Markdown."""

import numpy as np

LOW, HIGH = 0.935, 0.965
TITLE, END = "## Intervals that hold the truth", "\n## "

INTRODUCTION = """`python tests/benchmarks/coverage.py --jobs 2 --folder FOLDER --write`

Runs of 1,000 samples of the pendulum (noise 1 mrad) and of the cart between springs (0.1 mm), both of which come to
rest and stick, by `tests/independent.py`; the noise is white, or each sample is {ar:g} of the one before and new noise.
Each row counts over {n} noise seeds in how many of the fits the 95 % interval of a parameter holds the true value.
The scatter of the estimates is beside the mean of the standard deviations that the fits state."""


def counted(case, kind, entries):
    """Return a row for each parameter."""
    rows = []
    for name in entries[0]["estimates"]:
        found = np.array([entry["estimates"][name] for entry in entries if entry["success"]])
        rows.append(
            {
                "case": case,
                "kind": kind,
                "parameter": name,
                "n": len(entries),
                "failed": len(entries) - len(found),
                "inside": int(found[:, 1].sum()),
                "bias": float(found[:, 0].mean()),
                "scatter": float(found[:, 2].std(ddof=1)),
                "stated": float(found[:, 3].mean()),
            }
        )
    return rows


def section(results):
    """Return the lines of the section."""
    cells = results["cells"]
    lines = [TITLE, "", *INTRODUCTION.format(ar=results["ar"], n=cells[0]["n"]).splitlines(), ""]
    lines += [
        "| rig | noise | parameter | holds the truth | mean error | scatter | stated |",
        "|---|---|---|--:|--:|--:|--:|",
    ]
    for c in cells:
        share = c["inside"] / c["n"]
        mark = "" if LOW <= share <= HIGH else " (outside)"
        lines.append(
            f"| {c['case']} | {c['kind']} | `{c['parameter']}` | {100 * share:.1f} %{mark} | {c['bias']:+.2f} sd | "
            f"{c['scatter']:.3g} | {c['stated']:.3g} |"
        )
    outside = sum(not LOW <= c["inside"] / c["n"] <= HIGH for c in cells)
    failed = sum(c["failed"] for c in cells)
    return [
        *lines,
        "",
        f"Target: 93.5 to 96.5 % in each row, at most one row in 20 outside. {outside} of {len(cells)} rows are "
        f"outside; {failed} fits failed.",
        "",
    ]


def into(path, results):
    """Put the section into a page, in place of the one that stands there, or at its end."""
    text = path.read_text("utf-8")
    before, found, rest = text.partition(TITLE)
    after = rest[rest.index(END) + 1 :] if found and END in rest else ""
    path.write_text(
        before.rstrip("\n") + "\n\n" + "\n".join(section(results)) + ("\n" + after if after else ""), "utf-8"
    )
