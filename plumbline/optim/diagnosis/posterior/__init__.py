"""Which effects: the pool, evidence, selection, search, noise and gross rows."""
