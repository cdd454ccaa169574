"""One recording under every combination of options."""
