"""Numbers as people read them."""

import pytest

from app.scenario.number_text import in_one_style, plain, rounded, short, with_powers


@pytest.mark.parametrize(
    ("value", "read"),
    [(1.34e5, "134000"), (1.34e6, "1.34·10⁶"), (1e5, "10⁵"), (-2e-5, "−2·10⁻⁵"), (0.0, "0"), (-0.0, "0")],
)
def test_an_exponent_is_a_power_of_ten(value: float, read: str) -> None:
    assert plain(value) == read


def test_rounding_keeps_the_whole_part_where_it_is_asked_to() -> None:
    assert (rounded(13427.0), short(13427.0)) == ("13400", "13427")
    assert (rounded(0.12345), short(0.12345)) == ("0.123", "0.123")


def test_numbers_of_an_axis_have_one_style() -> None:
    assert in_one_style([1000.0, 10000.0]) == ["1000", "10000"]
    assert in_one_style([0.0, 1000.0, 20000.0, 1e5]) == ["0", "10³", "2·10⁴", "10⁵"]


@pytest.mark.parametrize(
    ("sentence", "read"),
    [
        ("contact.K_e: 1e+09 N/m; allowed: at most 2.5e+06", "contact.K_e: 10⁹ N/m; allowed: at most 2.5·10⁶"),
        ("is -3e-05, 1e+200.", "is −3·10⁻⁵, 10²⁰⁰."),
        (
            "recording '1e-05': /tmp/1e-05/run, 1e-05.npz, x-1e-05, 1e5",
            "recording '1e-05': /tmp/1e-05/run, 1e-05.npz, x-1e-05, 1e5",
        ),
        ("'x + 1e-05*y' at the arm's 1e+05 and the tool's", "'x + 1e-05*y' at the arm's 10⁵ and the tool's"),
    ],
)
def test_exponents_in_a_sentence_are_powers_of_ten_but_not_those_of_names(sentence: str, read: str) -> None:
    assert with_powers(sentence) == read
