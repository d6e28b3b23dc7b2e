"""Numbers as people read them."""

import pytest

from app.scenario.number_text import in_one_style, plain, rounded, short


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
