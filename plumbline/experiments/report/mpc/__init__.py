"""Pictures of instruments that move."""
