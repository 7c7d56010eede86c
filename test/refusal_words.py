"""What every refusal has to say: its value, its limit, which side of the limit is good, and the remedy."""

import re

from stereo_selfcal.core.rejection import Bound, Rejection

# A sentence may name the end of a range instead of saying "at least" or "at most".
_ENDS = {Bound.LEAST: "the least", Bound.MOST: "the greatest", Bound.EXACTLY: "the only"}


def assert_names_its_bound(rejection: Rejection) -> None:
    """Check that the sentence says whether the limit is a least or a most, or counts: 1 of 2."""
    value, limit = (re.escape(f"{number:.4g}") for number in (rejection.value, rejection.threshold))
    end = _ENDS[rejection.bound]
    forms = (f"{rejection.bound} {limit}", f"{value} of {limit}", rf"{end} \w+ searched is {limit}")
    assert any(re.search(form, rejection.finding) for form in forms), rejection.finding


def assert_says_everything(rejection: Rejection, *words: str) -> None:
    """Check that the message is one line with value, limit, bound, unit, remedy and the words."""
    assert rejection.remedy
    message = rejection.message
    for word in (
        f"{rejection.value:.4g}",
        f"{rejection.threshold:.4g}",
        rejection.unit,
        rejection.remedy,
        *words,
    ):
        assert word in message, message
    assert "\n" not in message
    assert "{value}" not in message and "{limit}" not in message
    assert_names_its_bound(rejection)
