"""One page for every method: the look, what can be on it, and how it becomes one HTML file."""
