"""Texts of data as they may be shown."""

import unicodedata


def legible(text: str) -> str:
    """Text in which the replacement character stands for what no page or terminal may be given.

    That is control characters, which can steer a terminal, and halves of surrogate pairs as in file
    names that are not UTF-8. Line breaks and tabs stay.
    """
    return "".join(
        "\N{REPLACEMENT CHARACTER}"
        if unicodedata.category(letter) in ("Cc", "Cs") and letter not in "\n\t"
        else letter
        for letter in text
    )
