"""Pictures of a gap budget."""
