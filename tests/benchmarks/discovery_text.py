"""The section of docs/validation.md on discovery in measured data, from what `discovery.py` recorded."""

import math

TITLE = "## Discovery in measured data, and on the rig in closed loop"
END = "\n## "
STUDIES = {
    "silverbox": "from a linear oscillator to a cubic spring; multisine at most 0.91 mV, arrow at most 0.96 mV",
    "dc_motor_deadzone": "dead zone or its friction equivalent, break-away, delay; the way down predicted",
    "dc_motor_deadzone_whole": "whole record at most 3.7 rpm, from 26.7",
    "dfki_pendulum": "Coulomb friction and an offset of the torque; weight over inertia within 3 % of 19.3",
    "schmidt_lipson": "viscous friction, then nothing more",
    "schmidt_lipson_pend": "viscous friction, then nothing more",
    "emps": "Coulomb friction, load and direction dependence; force error of the test run at most 5.4 %",
    "closed_loop_rig": "a rotor heavier than declared, Stribeck friction of the rail, a chain that gives way",
}
"""What each study should find."""
SHOWN = {"rad": (180 / math.pi, "deg"), "rad/s": (30 / math.pi, "rpm"), "m": (1e3, "mm")}


def section(results):
    """Return the section."""
    lines = [
        TITLE,
        "",
        "`python tests/benchmarks/discovery.py --write docs/validation.md` runs `cartpend discover` on each study, as",
        "it lies in `models/studies/`, with the whole catalogue at all places. Silverbox: 1 mm is 1 mV. Seconds are",
        "those of a machine that was shared.",
        "",
        "| study | should be found | found | verdict | seconds | commit |",
        "|---|---|---|---|--:|---|",
    ]
    for name, target in STUDIES.items():
        if name not in results:
            lines.append(f"| `{name}` | {target} | not run | | | |")
            continue
        r = results[name]
        found = ", ".join(f"`{step['effect']}` at `{step['at']}`" for step in r["steps"]) or "nothing"
        lines.append(f"| `{name}` | {target} | {found} | {r['verdict']} | {r['seconds']} | {r['commit']} |")
    lines += ["", "| study | run | output | before | after |", "|---|---|---|--:|--:|"]
    for name in STUDIES:
        for e in results.get(name, {}).get("errors", ()):
            factor, unit = SHOWN.get(e["unit"], (1.0, e["unit"]))
            before, after = (f"{factor * e[key]:.3g} {unit}" for key in ("rmse", "after"))
            lines.append(f"| `{name}` | {e['run']} ({e['role']}) | `{e['output']}` | {before} | {after} |")
    lines += ["", "What is left, in the words of the reports:", ""]
    lines += [f"- `{name}`: {results[name]['left']}" for name in STUDIES if results.get(name, {}).get("left")]
    return [*lines, ""]


def into(path, results):
    """Put the section into a page, in place of the one that stands there, or at its end."""
    text = path.read_text("utf-8")
    before, found, rest = text.partition(TITLE)
    after = rest[rest.index(END) + 1 :] if found and END in rest else ""
    body = "\n".join(section(results))
    path.write_text(before.rstrip("\n") + "\n\n" + body + ("\n" + after if after else ""), "utf-8")
