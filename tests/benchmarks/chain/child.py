"""What every child process of the scale benchmark does: take times and memory, print one line of JSON.

A child may run in an interpreter that has nothing but the tool it measures: standard library only.
"""

import json
import sys
import time

SPRING, DAMPING, MASS = 100.0, 1.0, 1.0  # N/m, N.s/m, kg
DISPLACEMENT, STOP, POINTS = 0.1, 1.0, 11  # m, s
RTOL, ATOL = 1e-8, 1e-10
MEMORY_LIMIT = 8  # GB, so that no tool takes the machine down


class Stages:
    """Wall and processor time [s] of consecutive stages, printed as they end, so that a run cut short leaves some."""

    def __init__(self):
        limit_memory()
        self.seconds, self.processor, self._last = {}, {}, (time.perf_counter(), time.process_time())

    def done(self, stage):
        """Note that `stage` has ended now; the next one begins."""
        now = time.perf_counter(), time.process_time()
        self.seconds[stage], self.processor[stage] = now[0] - self._last[0], now[1] - self._last[1]
        self._last = now
        print("\n" + json.dumps({"seconds": self.seconds, "processor": self.processor}), flush=True)


def limit_memory():
    """Make the process fail rather than swap."""
    if sys.platform == "linux":
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_LIMIT * 1024**3,) * 2)


def peak_memory():
    """Return the largest resident set of this process so far [MB].

    From /proc where there is one: Linux hands `ru_maxrss` of the parent on to a child that it starts.
    """
    try:
        with open("/proc/self/status") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024
    except OSError:
        import resource

        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak / (1024**2 if sys.platform == "darwin" else 1024)


def size():
    """Return the number of masses, from the command line."""
    return int(sys.argv[1])


def start(index):
    """Return the start position of a mass [m]; the first of them, index 0, is displaced."""
    return DISPLACEMENT if index == 0 else 0.0


def report(stages, memory_of_imports, **more):
    """Print what was measured as the last line of the output."""
    memory = {"peak": peak_memory(), "imports": memory_of_imports}
    print("\n" + json.dumps({"seconds": stages.seconds, "processor": stages.processor, "memory": memory} | more))
