"""From fits to a verdict, in figures and in words."""
