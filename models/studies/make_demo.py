"""Make the data of the demonstration where the studies are: ``python models/studies/make_demo.py [FOLDER]``.

The generator, the model and the study are those of `cartpend demo`; see `cartpend_dae.demo`. Without FOLDER it
is `demo` beside this file.
"""

import sys
from pathlib import Path

from cartpend_dae.demo import COULOMB, NOISE, RELEASES, VISCOUS, make_demo, pendulum

__all__ = ["COULOMB", "NOISE", "RELEASES", "VISCOUS", "make_demo", "pendulum"]

if __name__ == "__main__":
    print(make_demo(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent / "demo"))
