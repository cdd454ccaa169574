"""Gap budgets: numbers, each with its unit and where it comes from."""

# Answer
ROUNDING = 1e-9  # of a root that is real

# Shares
DRAWS = 2000  # two digits of a 95 % bound

# Sources
FEWEST = 4  # rows of a closed loop: a covariance of three axes needs them
SYMMETRIC = 1e-9  # of a covariance's largest entry, by which two entries may differ

# Spec
MOST_LINKS = 100  # a chain has ten

# Told
SAME_PLACE = 1e-6  # [m]: what six written digits round
