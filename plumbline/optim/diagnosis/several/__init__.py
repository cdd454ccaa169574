"""Several recordings of one robot, one verdict."""
