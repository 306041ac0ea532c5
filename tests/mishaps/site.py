"""A Dask cluster on this machine."""

import socket
import subprocess
import sys
from contextlib import contextmanager

from cartpend_dae.cluster import cluster


class Site:
    """A scheduler and workers in processes of their own, on this machine."""

    def __init__(self, folder):
        self.folder = folder
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        port = self.address.rpartition(":")[2]
        self.scheduler = self._start("dask_scheduler", "--host", "127.0.0.1", "--port", port)
        self.workers = []

    def hire(self):
        self.workers.append(self._start("dask_worker", self.address, "--nthreads", "2", "--no-nanny"))

    def _start(self, program, *arguments):
        command = [sys.executable, "-m", f"distributed.cli.{program}", *arguments, "--no-dashboard"]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=self.folder)

    def end(self):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@contextmanager
def site(folder, workers=2):
    made = Site(folder)
    try:
        for _ in range(workers):
            made.hire()
        with cluster(made.address) as place:
            place.client.wait_for_workers(workers, timeout=60)
            yield made, place
    finally:
        made.end()
