"""Directions in which the parameters may move without the data changing, in words of the parameters."""

from fractions import Fraction

import numpy as np

# what counts as a part of a direction, the largest denominator of an exponent, the largest exponent, and how far from a
# fraction it may be
PART, DENOMINATOR, EXPONENT, CLOSE = 0.02, 4, 4, 0.01
# what elimination leaves of rows, of size 1, that others make up
NOTHING = 1e-12


def blind_directions(names: tuple[str, ...], values: np.ndarray, null: np.ndarray) -> tuple[str, ...]:
    """Say what the data leave open, and which combinations they fix.

    Parameters
    ----------
    names
        The estimated quantities.
    values
        Their values (n,), SI.
    null
        Directions in SI (n, n_null) along which the outputs do not change.

    Returns
    -------
    tuple
        A sentence for each direction: products of powers where it scales all parts by simple powers, as it does where
        the model is a product of them; else that only some combination of the parts is identified.
    """
    if null.shape[1] == 0:
        return ()
    is_relative = bool(np.all(values[np.abs(null).max(axis=1) > 0] != 0))
    size = np.where(values != 0, np.abs(values), 1.0) if is_relative else np.abs(null).max(axis=1) + 1e-300
    sentences = []
    for direction in _echelon((null / size[:, None]).T):
        parts = [i for i in np.argsort(-np.abs(direction), kind="stable") if abs(direction[i]) > PART]
        parts = sorted(parts)
        if len(parts) == 1:
            sentences.append(unreached(names[parts[0]]))
        elif is_relative and _are_powers_simple(direction, parts):
            sentences.append(_scaling(names, direction * np.sign(values), parts))
        else:
            listing = " and ".join(f"`{names[i]}`" for i in parts)
            sentences.append(f"{listing} move the outputs alike: only a combination of them is identified")
    return tuple(sentences)


def unreached(name: str) -> str:
    """Return what is said of a quantity that alone does not change the outputs."""
    return f"`{name}` does not reach the outputs"


def _are_powers_simple(direction: np.ndarray, parts: list[int]) -> bool:
    """Whether the parts are scaled by small rational powers of each other; sums, for one, are not."""
    ratios = direction[parts] / direction[parts[-1]]
    powers = np.array([float(Fraction(float(ratio)).limit_denominator(DENOMINATOR)) for ratio in ratios])
    return bool(np.all(np.abs(powers) <= EXPONENT) and np.all(np.abs(ratios - powers) <= CLOSE * np.abs(ratios)))


def _scaling(names: tuple[str, ...], direction: np.ndarray, parts: list[int]) -> str:
    """Say which products of powers stay when all parts are scaled along a direction of their logarithms."""
    reference = parts[-1]
    products = []
    for i in parts[:-1]:
        power = Fraction(float(direction[i] / direction[reference])).limit_denominator(DENOMINATOR)
        if power == 0:
            continue
        products.append(_product(names[i], names[reference], power))
    listing = " and ".join(f"`{names[i]}`" for i in parts)
    only = " and ".join(f"`{product}`" for product in products)
    return f"{listing} can be scaled together: only {only} {'is' if len(products) == 1 else 'are'} identified"


def _product(name: str, reference: str, power: Fraction) -> str:
    exponent = "" if abs(power) == 1 else f"^{abs(power)}" if power.denominator == 1 else f"^({abs(power)})"
    return f"{name}{'/' if power > 0 else '*'}{reference}{exponent}"


def _echelon(rows: np.ndarray) -> np.ndarray:
    """Return the same space by rows with as few parts as elimination gives, the largest part 1.

    Rows that the others make up, or that are lost to numbers beyond all bounds, are left out.
    """
    rows = rows[np.all(np.isfinite(rows), axis=1) & np.any(rows != 0, axis=1)]
    matrix = rows / np.abs(rows).max(axis=1, keepdims=True)
    for k in range(len(matrix)):
        if np.abs(matrix[k:]).max() < NOTHING:
            matrix = matrix[:k]
            break
        column = int(np.argmax(np.abs(matrix[k:]).max(axis=0)))
        row = k + int(np.argmax(np.abs(matrix[k:, column])))
        matrix[[k, row]] = matrix[[row, k]]
        matrix[k] /= matrix[k, column]
        for other in range(len(matrix)):
            if other != k:
                matrix[other] -= matrix[other, column] * matrix[k]
    return matrix / np.abs(matrix).max(axis=1, keepdims=True)
