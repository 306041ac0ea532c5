"""Any bytes are read, or refused with a sentence; the corpus that fuzzing found is read again each time."""

import os
import signal

import pytest
from fuzz.readers import CORPUS, READERS
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cartpend_dae.errors import StudyError
from cartpend_dae.parallel import survives

KEPT = [pytest.param(path.parent.name, path, id=f"{path.parent.name}-{path.name}") for path in CORPUS.glob("*/*")]
NEEDS = {"hdf5": "h5py", "parquet": "pyarrow", "mo": "pymoca"}


def reader(name):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    return READERS[name]


@pytest.mark.parametrize(("name", "path"), KEPT)
def test_what_fuzzing_found_is_read_or_refused(name, path):
    reader(name)(path.read_bytes())


@pytest.mark.parametrize("name", READERS)
def test_the_seeds_hold_something_that_is_accepted(name):
    assert any([reader(name)(seed) for seed in reader(name).seeds()])


def edits(seeds):
    """Return a strategy for seeds that are cut, overwritten, and joined."""

    def edited(pair, cuts, new, at):
        one, other = pair
        place = at % (len(one) + 1)
        return (one[:place] + new + one[place + cuts :]) if cuts else one[:place] + other[place:]

    seed = st.sampled_from(seeds)
    return st.builds(edited, st.tuples(seed, seed), st.integers(0, 40), st.binary(max_size=20), st.integers(0, 10**6))


@pytest.mark.parametrize("name", READERS)
def test_damaged_files_are_read_or_refused(name):
    read = reader(name)
    settle = settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))

    @settle
    @given(edits(read.seeds()))
    def holds(content):
        read(content)

    holds()


def test_a_library_that_crashes_takes_only_its_own_process_with_it():
    assert survives(lambda: None) and survives(lambda: 1 / 0)
    assert not survives(lambda: os.kill(os.getpid(), signal.SIGSEGV))


def test_a_file_that_crashes_its_reader_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "run.mat"
    path.write_bytes((CORPUS / "mat" / "crash-in-scipy").read_bytes())
    # whether scipy crashes at it depends on memory that it reads beyond the file: either way one sentence follows
    with pytest.raises(StudyError, match=r"the file is damaged, so that what reads it crashes|that can be read"):
        READERS["mat"].read(path)
    monkeypatch.setattr("scipy.io.loadmat", lambda *_, **__: os.kill(os.getpid(), signal.SIGSEGV))
    with pytest.raises(StudyError, match="the file is damaged, so that what reads it crashes"):
        READERS["mat"].read(path)
