"""Print how near each reference example comes: python tests/msl/table.py [name ...].

Columns: example, worst use of the tube (1 is its edge), number of signals, events, those of Dymola's run as the spec
has them (at known times + located), seconds of assembly and simulation.
The references are found by CARTPEND_MSL.
"""

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent.parent)]

from msl_bench import EXAMPLES, load, run  # noqa: E402 (found by the path above)


def main(names: list[str]) -> int:
    folder = Path(os.environ.get("CARTPEND_MSL", "")).resolve()
    if not (folder / "specs").is_dir():
        print("Set CARTPEND_MSL to the folder of the reference examples.", file=sys.stderr)
        return 2
    failed = 0
    print(f"{'example':<28} {'tube use':>9} {'signals':>8} {'events':>7} {'Dymola':>9} {'seconds':>8}")
    for path in EXAMPLES:
        if names and path.stem not in names:
            continue
        try:
            outcome = run(example := load(path, folder))
        except Exception as error:  # the table goes on to the next example
            failed += 1
            print(f"{path.stem:<28} {type(error).__name__}: {str(error)[:300]}")
            continue
        failed += outcome.worst > 1
        dymola = example.spec["reference"].get("reference_run")
        theirs = f"{dymola['time_events']} + {dymola['state_events']}" if dymola else "-"
        figures = f"{outcome.worst:>9.2g} {len(outcome.use):>8} {outcome.events:>7} {theirs:>9} {outcome.seconds:>8.2f}"
        print(f"{path.stem:<28} {figures}", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
