"""How an answer is shown is filled in from outside: an answer knows nothing of pictures."""

CARDS: list[str] = []  # modules whose ``card_of`` makes the card of any answer; the last one does
DRAWN: list[str] = []  # modules whose ``DRAWN`` has the pictures by name, by the class of an answer
