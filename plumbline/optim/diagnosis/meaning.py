"""What a verdict comes to, in a sentence each: of its kind, or of why it is no more than that."""

MEANING = {
    "no-gap": "There is nothing beyond noise.",
    "explained": "The causes named below bring the held-out residual to the noise floor.",
    "partly-explained": (
        "The causes named below do part of it; something beyond them and noise remains."
    ),
    "outside-library": "There is a gap, and no effect of the library explains it.",
}
NOTHING_FURTHER = (
    "Beyond the causes named below nothing further was found; no noise is stated, so how small "
    "what is left would have to be is not known."
)
ON_A_BOUND = "Nothing further was found, but a parameter rests on its bound: it may lie beyond."
TOO_FEW = "No gap shows, but rows left out are missed by far: too few are left to foretell them by."
NOT_FORETOLD = (
    "The causes named below bring all rows together to the noise floor; rows that were left out "
    "they do not foretell."
)
NOISIER = "What is left follows nothing that was recorded: noise, larger than it is stated."
NOT_SHOWN = (
    "The causes named below are more probable than not; rows that were left out do not show that "
    "the gap shrinks with them."
)
ONLY_CONFOUNDED = (
    "There is a gap. Effects of the library foretell part of it, each confounded with something "
    "nearly like it: none is sure to be the cause."
)
# Where the noise is known from the fit alone, what is left can be told from noise by its form only.
MEANING_BY_FORM = MEANING | {
    "no-gap": "There is nothing that does not look like noise.",
    "explained": "What the causes named below leave looks like noise.",
    "partly-explained": (
        "The causes named below do part of it; what is left does not look like noise."
    ),
}
