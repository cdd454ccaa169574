"""How an answer is shown is filled in from outside: an answer knows nothing of pictures."""

CARDS: dict[str, str] = {}  # class of an answer that makes none of its own -> "module:function"
DRAWN: list[str] = []  # modules whose ``DRAWN`` has the pictures by name, by the class of an answer
