"""Define the error that tells users how to correct a request, find misspelt words, and shorten other errors."""

from collections.abc import Iterable


class UserError(ValueError):
    """Raised for a request that cannot be met; its message says in one line what is wrong and what to type instead."""

    def __init__(self, message: object) -> None:
        super().__init__(on_a_line(str(message)))


def on_a_line(text: str, besides: str = "") -> str:
    r"""Escape control characters other than ``besides``, because file names may contain line breaks or terminal codes.

    >>> print(on_a_line("a\x1b[31m\n.png"), on_a_line("é ☃"))
    a\x1b[31m\n.png é ☃
    """
    return "".join(one if one.isprintable() or one in besides else repr(one)[1:-1] for one in text)


def similar_words(word: str, names: Iterable[str]) -> list[str]:
    """List up to three names that a word may misspell or, if there are none, begin; the list is often empty.

    These are the names with the fewest edits from the word: at most one, two for a word of more than four letters, or
    three for more than eight. An edit inserts, deletes or replaces a letter, or swaps two; capitals do not count.

    >>> similar_words("expotr", ["text", "export"]), similar_words("god", ["draft", "normal"])
    (['export'], [])
    >>> similar_words("Oill", ["ink", "oil"]), similar_words("abstr", ["abstract"])
    (['oil'], ['abstract'])
    """
    word = word.lower()
    limit = 1 if len(word) <= 4 else 2 if len(word) <= 8 else 3
    edits = {}
    for name in names:
        plain = name.lower()
        if abs(len(plain) - len(word)) <= limit and (number := _edits(word, plain)) <= min(limit, len(word) - 1):
            edits[name] = number
        elif len(word) > 2 and plain.startswith(word):
            edits[name] = limit + 1
    return [name for name in edits if edits[name] == min(edits.values())][:3]


def _edits(one: str, other: str) -> int:
    """Count the edits that turn one word into another (Damerau-Levenshtein distance, optimal string alignment)."""
    before: list[int] = []
    row = [*range(len(other) + 1)]
    for i, letter in enumerate(one, start=1):
        last, before, row = before, row, [i]
        for j, theirs in enumerate(other, start=1):
            least = min(before[j] + 1, row[j - 1] + 1, before[j - 1] + (letter != theirs))
            if i > 1 and j > 1 and one[i - 2 : i] == other[j - 2 : j][::-1]:
                least = min(least, last[j - 2] + 1)
            row.append(least)
    return row[-1]


def first_line(error: BaseException) -> str:
    """Return the first line of an error message, preceded by the error's type unless it is a `UserError`."""
    text = str(error).strip().partition("\n")[0]
    kind = type(error).__name__
    return text if isinstance(error, UserError) else f"{kind}: {text}" if text else kind
