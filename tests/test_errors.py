import pytest

from cartpend_dae import errors


@pytest.mark.parametrize(
    ("error", "standard", "exit_code"),
    [
        (errors.ModelError, ValueError, 2),
        (errors.StudyError, ValueError, 2),
        (errors.StructureError, errors.CartpendError, 2),
        (errors.SolverError, RuntimeError, 1),
        (errors.CutOffError, RuntimeError, 1),
        (errors.LostError, errors.CutOffError, 1),
    ],
)
def test_each_error_is_caught_by_its_base_and_by_the_standard_class(error, standard, exit_code):
    for caught in (errors.CartpendError, standard):
        with pytest.raises(caught, match="a sentence") as raised:
            raise error("a sentence")
        assert raised.value.exit_code == exit_code
