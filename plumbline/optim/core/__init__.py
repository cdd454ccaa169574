"""Problem, mapped rows, solution, solvers, and the judge of a solution."""
